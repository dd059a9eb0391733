"""The coarse index: the right map comes first, and maps that are not seen, or are gone, change nothing."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.config import OccupancyConfig
from firstfix.engine.map_choice import coarse_index
from firstfix.engine.map_choice.coarse_index import MAX_BLOCKS, CoarseIndex
from firstfix.engine.map_choice.coarse_templates import CoarseTemplates, spread_order
from firstfix.engine.map_choice.sought_scan import SHIFTS_M, SoughtScan, describe_sought
from firstfix.errors import CorruptVersion
from firstfix.scan.compact import ScanDescriptor
from firstfix.scan.scan import Scan

CONFIG = OccupancyConfig(rings=10, sectors=40, max_range_m=20.0)
OTHER_CONFIG = OccupancyConfig(rings=10, sectors=40, max_range_m=30.0)
EACH = 30


def filled(seed: int, rows: int = EACH) -> np.ndarray:
    """(rows, layers * rings, sectors) arcs, as walls make them."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((rows, 50, 40), np.uint8)
    for row in cells:
        for _ in range(60):
            ring, start, length = rng.integers(30), rng.integers(40), rng.integers(2, 9)
            row[ring, (start + np.arange(length)) % 40] = 1
    return cells


def packed(cells: np.ndarray) -> np.ndarray:
    return np.packbits(cells.reshape(len(cells), -1), axis=1)


def templates(seed: int, config: OccupancyConfig = CONFIG) -> CoarseTemplates:
    positions = np.random.default_rng(seed).uniform(0, 20, (EACH, 3))
    return CoarseTemplates.of(config, positions, {"occupancy": packed(filled(seed))})


def sought(seed: int, config: OccupancyConfig = CONFIG) -> SoughtScan:
    """A scan of one of the map's places: turned, and a tenth of its cells changed."""
    rng = np.random.default_rng(seed + 1000)
    cells = np.roll(filled(seed)[7:8], 11, axis=2)
    cells[:, :30] ^= (rng.uniform(size=(1, 30, 40)) < 0.1).astype(np.uint8)
    return SoughtScan({config.model_dump_json(): ({"occupancy": packed(cells)},)})


def everything(map_id: str) -> bool:
    return True


def index_of(tmp_path: Path, count: int, **changes: int) -> CoarseIndex:
    index = CoarseIndex(tmp_path, **changes)
    index.change({f"m{seed}": templates(seed) for seed in range(count)})
    return index


def test_the_map_of_the_scan_comes_first(tmp_path: Path):
    index = index_of(tmp_path, 60)
    found = [index.best(sought(seed), everything, 8) for seed in range(60)]
    assert [best[0] for best in found] == [f"m{seed}" for seed in range(60)]
    assert all(len(best) == len(set(best)) <= 8 for best in found)


def test_keys_find_the_map_also_where_few_templates_are_compared(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(coarse_index, "COMPARED", 20)  # of 1,800
    index = index_of(tmp_path, 60)
    right = sum(f"m{seed}" in index.best(sought(seed), everything, 8) for seed in range(60))
    assert right >= 57


@pytest.mark.parametrize("compared", [20, 400])
@pytest.mark.parametrize("seen", [3, 25, 55])
def test_maps_that_are_not_seen_change_nothing(tmp_path: Path, monkeypatch, compared: int, seen: int):
    monkeypatch.setattr(coarse_index, "COMPARED", compared)
    both, alone = index_of(tmp_path, 60), CoarseIndex(tmp_path)
    names = {f"m{seed}" for seed in range(seen)}
    alone.change({f"m{seed}": templates(seed) for seed in range(seen)})
    for seed in (0, seen - 1):
        best = both.best(sought(seed), names.__contains__, 8)
        assert best[0] == f"m{seed}" == alone.best(sought(seed), everything, 8)[0]
        assert set(best) <= names


def test_maps_come_go_and_change(tmp_path: Path):
    index = CoarseIndex(tmp_path)
    for seed in range(40):
        index.change({f"m{seed}": templates(seed)})
        assert len(index._state[1]) <= MAX_BLOCKS
    assert len(index) == 40
    index.change({"m5": templates(500)}, gone=["m6", "unknown"])
    assert "m6" not in index
    assert "m6" not in index.best(sought(6), everything, 40)
    assert index.best(sought(500), everything, 8)[0] == "m5"
    assert index.best(sought(5), everything, 1) != ["m5"]
    index.change({}, gone=[f"m{seed}" for seed in range(35)])
    assert index.best(sought(38), everything, 8)[0] == "m38"
    assert index.templates <= 2 * 5 * EACH, "what has gone is given back"
    index.change({}, gone=[f"m{seed}" for seed in range(40)])
    assert (len(index), index.templates, index.forms) == (0, 0, ())
    assert index.best(sought(1), everything, 8) == []


def test_maps_of_other_descriptors_are_found_by_their_own(tmp_path: Path):
    index = index_of(tmp_path, 20)
    index.change({"other": templates(77, OTHER_CONFIG)})
    assert set(index.forms) == {CONFIG.model_dump_json(), OTHER_CONFIG.model_dump_json()}
    assert index.best(sought(77, OTHER_CONFIG), everything, 8) == ["other"]
    both = SoughtScan({**sought(77, OTHER_CONFIG).described, **sought(77).described})
    assert index.best(both, everything, 8)[0] == "other"


def test_many_maps_have_fewer_templates_each(tmp_path: Path):
    index = index_of(tmp_path, 20, max_templates=400)
    assert 20 * 16 <= index.templates <= 400
    index.change({f"m{seed}": templates(seed) for seed in range(20, 40)})
    assert 40 * 8 <= index.templates <= 400
    expecting = CoarseIndex(tmp_path, max_templates=400)
    expecting.change({"m0": templates(0)}, expected=40)
    assert 8 <= expecting.templates <= 10


def test_the_first_templates_stand_evenly():
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(400)])
    order = spread_order(positions, 100)
    assert len(set(order.tolist())) == 100
    for count, farthest_m in ((25, 4.5), (100, 2.3)):
        away = np.linalg.norm(positions[:, None] - positions[order[:count]][None], axis=2).min(axis=1)
        assert away.max() < farthest_m


def contents(**changes: bytes) -> dict[str, bytes]:
    def npy(array: np.ndarray) -> bytes:
        file = io.BytesIO()
        np.save(file, array)
        return file.getvalue()

    return {
        "engine.json": json.dumps({"descriptor": CONFIG.model_dump()}).encode(),
        "template_position_m.npy": npy(np.zeros((4, 3), np.float32)),
        "template_occupancy.npy": npy(packed(filled(1, 4))),
        **changes,
    }


def test_reads_a_version():
    read = CoarseTemplates.read(contents().__getitem__)
    assert len(read) == 4
    assert read.form == CONFIG.model_dump_json()


@pytest.mark.parametrize(
    "changes",
    [
        {"engine.json": b"{}"},
        {"engine.json": b"[]"},
        {"engine.json": b'{"descriptor": {"kind": "occupancy", "rings": 0}}'},
        {"template_position_m.npy": b""},
        {"template_position_m.npy": contents()["template_occupancy.npy"]},
        {"template_occupancy.npy": contents()["template_occupancy.npy"][:200]},
        {"template_occupancy.npy": contents()["template_position_m.npy"]},
    ],
)
def test_a_damaged_version_is_refused(changes: dict[str, bytes]):
    with pytest.raises(CorruptVersion):
        CoarseTemplates.read(contents(**changes).__getitem__)


def test_a_scan_is_described_from_spots_around(small_scans):
    form = CONFIG.model_dump_json()
    scan, _ = small_scans[0]
    described = describe_sought(scan, LocalizeOptions(), [form])
    (rows,) = described.described[form]
    assert rows["occupancy"].shape == (len(SHIFTS_M), 250)
    assert len({row.tobytes() for row in rows["occupancy"]}) == len(SHIFTS_M)


def test_a_scan_with_too_few_points_is_not_described():
    nearly_nothing = Scan.from_points(np.ones((3, 3)))
    assert describe_sought(nearly_nothing, LocalizeOptions(), [CONFIG.model_dump_json()]).described == {}


def test_a_descriptor_alone_has_the_forms_that_agree():
    own = ScanDescriptor(
        LayeredOccupancy(PolarGrid(10, 40, 20.0)), packed(filled(3))[0], np.array([0.0, 0.0, 1.0]), 1.0
    )
    forms = [OTHER_CONFIG.model_dump_json(), CONFIG.model_dump_json()]
    described = describe_sought(own, LocalizeOptions(), forms).described
    assert list(described) == [forms[1]]
