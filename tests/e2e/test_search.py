"""Search on a real version: candidates, its later steps, a prior, and keys in shards."""

import shutil
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from firstfix.answer.localization import Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.builds.config import PerturbConfig
from firstfix.engine.candidates import find_candidates
from firstfix.engine.config import ENGINE_FILE, EngineConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.preprocess import preprocess
from firstfix.engine.retrieval.cascade import Cascade
from firstfix.engine.retrieval.key_search import build_key_search, tile_shards
from firstfix.engine.retrieval.template_tiles import FILE
from firstfix.errors import CorruptVersion
from firstfix.native import MOST_PER_SPOT, SPOT_DEG, SPOT_M
from firstfix.scan.sequence import ScanSequence
from firstfix.sensor import SensorModel
from firstfix.transform import pose_error, yaw_of
from firstfix_builder.index.index_files import make_keys
from firstfix_builder.simulation.perturb import elsewhere, perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from tests.python_cascade import PythonCascade, searched_by
from tests.small_world import SENSOR


@pytest.fixture(scope="module")
def foreign_scan():
    rng = np.random.default_rng(15)
    spots = np.column_stack([rng.uniform(-12, 12, (50, 2)), np.full(50, 0.8)])
    sensor = SensorModel.from_mapping(SENSOR)
    return perturbed_scans(Simulator(*elsewhere(rng)), sensor, spots, 1.0, 1, PerturbConfig(), rng)[0][0]


def proposed(index, scan, effort=1, options=None):
    prepared = preprocess(ScanSequence.single(scan), None, index.config.preprocess)
    (only,) = prepared.scans
    described = only.described_by(index.cascade.descriptor)
    return find_candidates(index, described, only, options or LocalizeOptions(), effort)


def test_candidates_of_one_spot_are_bounded(index, small_scans):
    for scan, _ in small_scans[:6]:
        poses = list(proposed(index, scan).T_level_sensor)
        assert 3 <= len(poses) <= index.config.search.candidates
        for last, pose in enumerate(poses):
            errors = [pose_error(pose, earlier) for earlier in poses[:last]]
            beside = sum(metres < SPOT_M - 1e-6 and degrees < SPOT_DEG for metres, degrees in errors)
            assert beside < MOST_PER_SPOT


def test_more_effort_adds_candidates_and_keeps_the_others(index, small_scans):
    few = proposed(index, small_scans[0][0])
    many = proposed(index, small_scans[0][0], effort=2)
    assert len(many) > len(few)
    of_few = set(few.template.tolist())
    # what more keys bring may come before some of them, but their order stays
    assert [row for row in many.template.tolist() if row in of_few] == few.template.tolist()


def searched(index) -> tuple[Localizer, list[int]]:
    """Returns a localizer, and a list of the clusters that its searches ask for."""
    asked: list[int] = []

    class Telling(PythonCascade):
        def search(self, described, clusters):
            asked.append(clusters)
            return super().search(described, clusters)

    return Localizer(searched_by(index, Telling)), asked


def test_a_convincing_answer_is_searched_for_once(index, small_scans):
    localizer, asked = searched(index)
    accepted = next(
        scan for scan, _ in small_scans if Localizer(index).localize(scan).verdict is Verdict.LOCALIZED
    )
    localizer.localize(accepted)
    assert asked == [index.config.search.clusters]


def test_an_unsure_answer_is_searched_step_by_step(index, foreign_scan):
    localizer, asked = searched(index)
    assert localizer.localize(foreign_scan).verdict is not Verdict.LOCALIZED
    search = index.config.search
    steps = [asked[0], *(b for a, b in pairwise(asked) if a != b)]
    ups, wide, last = steps[2], steps[1] * asked.count(steps[1]), steps[3] * asked.count(steps[3])
    assert steps[0] == ups == search.clusters
    assert search.wide.clusters * 0.9 <= wide <= search.wide.clusters, "shared by the ways to level the scan"
    assert search.exhaustive.clusters * 0.9 <= last <= search.exhaustive.clusters


def test_a_version_may_forbid_the_later_steps(index, foreign_scan):
    config = index.config
    search = config.search.model_copy(update={"widened": 1})
    localizer, asked = searched(replace(index, config=config.model_copy(update={"search": search})))
    localizer.localize(foreign_scan)
    assert set(asked) == {search.clusters}


def test_a_limit_of_candidates_is_kept(index, foreign_scan):
    localizer, asked = searched(index)
    localizer.localize(foreign_scan, LocalizeOptions(max_candidates=5))
    assert set(asked) == {index.config.search.clusters}
    assert len(proposed(index, foreign_scan, options=LocalizeOptions(max_candidates=5))) <= 5


def test_a_right_prior_keeps_the_answer(index, small_scans):
    localizer = Localizer(index)
    for scan, T_map_sensor in small_scans[:8]:
        free = localizer.localize(scan)
        prior = Prior(T_map_sensor[:3, 3], 1.5, np.degrees(yaw_of(T_map_sensor)), 20.0)
        answer = localizer.localize(scan, LocalizeOptions(prior=prior))
        if free.hypotheses and pose_error(T_map_sensor, free.hypotheses[0].T_map_sensor)[0] < 0.1:
            assert pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)[0] < 0.1


def test_every_answer_lies_within_a_wrong_prior(index, small_scans):
    localizer = Localizer(index)
    for scan, T_map_sensor in small_scans[:8]:
        other = np.array([-np.sign(T_map_sensor[0, 3]) * 5.0, 0.0, T_map_sensor[2, 3]])
        prior = Prior(other, 2.0)
        for hypothesis in localizer.localize(scan, LocalizeOptions(prior=prior)).hypotheses:
            assert prior.allows(hypothesis.T_map_sensor)


def test_a_prior_off_the_map_has_no_candidate(index, small_scans):
    prior = Prior(np.array([500.0, 0, 0]), 3.0)
    answer = Localizer(index).localize(small_scans[0][0], LocalizeOptions(prior=prior))
    assert (answer.verdict, answer.reasons) == (Verdict.REJECTED, (Reason.NO_CANDIDATE,))


def test_a_small_radius_compares_only_the_templates_in_it(index, small_scans):
    compared = []

    class Counting(PythonCascade):
        def search_near(self, described, *how):
            found = super().search_near(described, *how)
            compared.append(found.rows)
            return found

    scan, T_map_sensor = small_scans[0]
    for radius_m in (1.5, 1e3):
        options = LocalizeOptions(prior=Prior(T_map_sensor[:3, 3], radius_m))
        Localizer(searched_by(index, Counting)).localize(scan, options)
    near, everywhere = compared
    away_m = np.linalg.norm(index.cascade.templates.position_m[near] - T_map_sensor[:3, 3], axis=1)
    assert away_m.max() <= 1.5 + index.config.spacing_m
    assert len(near) < len(everywhere)


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


def test_sharded_and_single_keys_give_the_same_answers(versions, small_scans):
    whole, parted = (Localizer(MapIndex.load(folder)) for folder in versions)
    assert len(list(versions[1].glob("keys_*.faiss"))) > 1
    for scan, T_map_sensor in small_scans[:6]:
        near = LocalizeOptions(prior=Prior(T_map_sensor[:3, 3], 5.0))
        for options in (LocalizeOptions(), near):
            one, other = whole.localize(scan, options), parted.localize(scan, options)
            assert one.verdict is other.verdict
            assert [h.template for h in one.hypotheses] == [h.template for h in other.hypotheses]
            assert np.array_equal(one.T_map_sensor, other.T_map_sensor)


def test_a_search_with_a_prior_is_exhaustive(versions, small_scans):
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
