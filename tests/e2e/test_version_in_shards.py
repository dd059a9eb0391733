"""A version with sharded keys answers like one with a single index, and names missing files."""

import shutil

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.config import ENGINE_FILE, EngineConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.retrieval.cascade import Cascade
from firstfix.engine.retrieval.key_search import build_key_search, tile_shards
from firstfix.engine.retrieval.template_tiles import FILE
from firstfix.errors import CorruptVersion
from firstfix_builder.index.index_files import make_keys

FEW = {"clusters": 20, "candidates": 5}  # of the small world's two hundred


@pytest.fixture
def versions(small_version, tmp_path, monkeypatch):
    """Folders of one version, with a single index and with shards."""
    monkeypatch.setattr(tile_shards, "TILE_M", 3.0)
    folders = []
    for name, search in (("whole", FEW), ("parted", FEW | {"shard_keys": 100})):
        folder = shutil.copytree(small_version.directory, tmp_path / name)
        kept = EngineConfig.load(folder)
        engine = kept.model_copy(update={"search": kept.search.model_copy(update=search)})
        (folder / ENGINE_FILE).unlink()
        (folder / ENGINE_FILE).write_text(engine.model_dump_json())
        made = Cascade.load(folder, kept)
        rows = made.clusters.representative
        keys = make_keys(made.templates, rows, made.descriptor, made.projection, folder)
        (folder / "keys.faiss").unlink()
        build_key_search(keys, engine.search, made.templates.position_m[rows]).save(folder)
        folders.append(folder)
    return folders


def test_both_answer_the_same_with_a_prior_and_without(versions, small_scans):
    whole, parted = (Localizer(MapIndex.load(folder)) for folder in versions)
    assert len(list(versions[1].glob("keys_*.faiss"))) > 1
    for scan, T_map_sensor in small_scans[:6]:
        near = LocalizeOptions(prior=Prior(T_map_sensor[:3, 3], 5.0))
        for options in (LocalizeOptions(), near):
            one, other = whole.localize(scan, options), parted.localize(scan, options)
            assert one.verdict is other.verdict
            assert [h.template for h in one.hypotheses] == [h.template for h in other.hypotheses]
            assert np.array_equal(one.T_map_sensor, other.T_map_sensor)


def test_with_a_prior_the_search_is_that_of_all_distances(versions, small_scans):
    """All keys of the templates within the sphere are compared."""
    for folder in versions:
        cascade = MapIndex.load(folder).cascade
        templates = cascade.templates
        every = np.arange(len(templates))
        keys = make_keys(templates, every, cascade.descriptor, cascade.projection, folder)
        for row in every[::17]:
            described, centre = templates.described_at(every[row : row + 1]), templates.position_m[row] + 0.3
            found = np.sort(cascade.search_near(described, centre, 6.0, 20).rows)
            near = np.flatnonzero(np.linalg.norm(templates.position_m - centre, axis=1) <= 6.0)
            away = np.linalg.norm(keys[near] - cascade.key_of(described), axis=1)
            assert len(found) == min(20, len(near))
            assert np.isin(found, near).all()
            order = np.argsort(away)
            sure = near[order][away[order] < np.sort(away)[:20][-1] - 0.1]  # 8 bits blur the last ones
            assert np.isin(sure, found).all()


@pytest.mark.parametrize(
    "name", ["keys_000.faiss", "keys_001.faiss", "keys_shards.safetensors", FILE, "template_position_m.npy"]
)
def test_a_damaged_or_missing_file_is_a_corrupt_version(versions, name):
    folder = versions[1]
    content = (folder / name).read_bytes()
    for damage in (content[: len(content) // 2], b"", None):
        (folder / name).unlink()
        if damage is not None:
            (folder / name).write_bytes(damage)
        with pytest.raises(CorruptVersion):
            MapIndex.load(folder)
        (folder / name).write_bytes(content)


def test_keys_of_another_number_of_templates_are_a_corrupt_version(versions, small_version):
    folder = versions[0]
    keys = np.random.default_rng(1).random((50, 800)).astype(np.float32)
    (folder / "keys.faiss").unlink()
    build_key_search(keys, EngineConfig().search).save(folder)
    with pytest.raises(CorruptVersion, match="50 keys"):
        MapIndex.load(folder)
