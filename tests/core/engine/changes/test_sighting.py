"""Cells that a scan confirms, sees through, or cannot explain: exact geometry."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.engine.changes.cells import cells_of, cells_of_keys, keys_of, slot_of, spot_of
from firstfix.engine.changes.sighting import Sighting, sighting_of
from firstfix.scan.compact import CompactScan
from firstfix.scan.reduction import nearest_by_direction
from firstfix.scan.scan import Scan
from tests.changed_hall import Hall, pose, standing

SIZE_M = (16.0, 10.0, 4.0)
RACK = (9.2, 4.2, 0.0, 10.3, 6.3, 2.3)
AWAY = (9.2, 7.7, 0.0, 10.3, 9.8, 2.3)
AT = pose(4.1, 5.2)


def sighted(mapped: Hall, now: Hall, T: NDArray[np.float64] = AT, seed: int = 3) -> Sighting:
    rng = np.random.default_rng(seed)
    return sighting_of(mapped.index, now.scan(now.simulator(), T, rng), T)


def cells(keys: NDArray[np.int64]) -> set[tuple[int, ...]]:
    return {tuple(cell) for cell in cells_of_keys(keys).tolist()}


def within(found: set[tuple[int, ...]], box: tuple[float, ...], margin_m: float) -> bool:
    low, high = np.array(box[:3]) - margin_m, np.array(box[3:]) + margin_m
    middles = (np.array(sorted(found)) + 0.5) * 0.5
    return bool(((middles > low) & (middles < high)).all())


@pytest.fixture(scope="module")
def empty() -> Hall:
    return Hall(SIZE_M, standing())


@pytest.fixture(scope="module")
def racked() -> Hall:
    return Hall(SIZE_M, standing(RACK))


def test_an_unchanged_hall_is_confirmed(racked: Hall):
    seen = sighted(racked, racked)
    assert len(seen.contradicted) == len(seen.unexplained) == 0
    face = {(18, y, z) for y in (9, 10, 11) for z in (1, 2, 3)}
    assert face <= cells(seen.confirmed)
    assert (22, 10, 2) not in cells(seen.confirmed), "it lies behind the rack"
    assert (8, 10, 2) in cells(seen.free)


def test_a_rack_that_left_is_seen_through(racked: Hall, empty: Hall):
    seen = sighted(racked, empty)
    gone = cells(seen.contradicted)
    assert {(18, y, z) for y in (9, 10, 11) for z in (1, 2, 3)} <= gone
    assert within(gone, RACK, 0.3)
    assert not gone & cells(seen.confirmed)
    assert len(seen.unexplained) == 0


def test_a_rack_that_came_is_not_explained(racked: Hall, empty: Hall):
    seen = sighted(empty, racked)
    new = cells(seen.unexplained)
    assert {(18, y, z) for y in (9, 10, 11) for z in (1, 2, 3)} <= new
    assert within(new, RACK, 0.3)
    assert not new & cells(seen.free)
    assert len(seen.contradicted) <= 1, "a stray cell of the ceiling, seen along it"
    assert (26, 10, 2) not in cells(seen.free), "the rack hides what lies behind"


def test_a_rack_that_moved_is_both(racked: Hall):
    seen = sighted(racked, Hall(SIZE_M, standing(AWAY)))
    assert within(cells(seen.contradicted), RACK, 0.3)
    assert within(cells(seen.unexplained), AWAY, 0.3)
    assert len(seen.contradicted) > 10
    assert len(seen.unexplained) > 10


def test_what_the_map_does_not_cover_is_not_new(racked: Hall):
    """A door was shut when the map was made: nothing is mapped behind it."""
    index = Hall((8.0, 10.0, 4.0), standing()).index
    rng = np.random.default_rng(2)
    seen = sighting_of(index, racked.scan(racked.simulator(), AT, rng), AT)
    assert not any(x > 16 for x, _, _ in cells(seen.unexplained))
    assert {(16, 10, 2)} <= cells(seen.contradicted) | {(15, 10, 2)}, "the wall is seen through"


def test_every_attribute_names_a_cell_once(racked: Hall, empty: Hall):
    seen = sighted(racked, empty)
    for keys in (seen.confirmed, seen.contradicted, seen.unexplained, seen.free):
        assert (np.diff(keys) > 0).all()


def test_a_compact_scan_shows_the_same(racked: Hall, empty: Hall):
    rng = np.random.default_rng(3)
    scan = empty.scan(empty.simulator(), AT, rng)
    compact = CompactScan(scan.points[:300], nearest_by_direction(scan.points))
    whole, ranges = (sighting_of(racked.index, one, AT) for one in (scan, compact))
    gone, too = cells(whole.contradicted), cells(ranges.contradicted)
    assert within(too, RACK, 0.3)
    assert len(gone & too) > 0.6 * len(gone)


def test_a_scan_without_returns_shows_nothing(racked: Hall):
    seen = sighting_of(racked.index, Scan(np.empty((0, 3), np.float32)), AT)
    assert [len(keys) for keys in (seen.confirmed, seen.contradicted, seen.unexplained, seen.free)] == [0] * 4


def test_a_map_far_from_its_origin_has_cells_too():
    far = np.array([[450_000.2, -450_000.7, 12.3]])
    assert (cells_of_keys(keys_of(cells_of(far))) == [[900_000, -900_002, 24]]).all()
    with pytest.raises(ValueError, match="500 km"):
        keys_of(cells_of(far * 2))


def test_spots_spread_over_the_slots():
    slots = [slot_of(spot_of(np.array([x, y, 0.5]))) for x in range(40) for y in range(40)]
    counts = np.bincount(slots, minlength=32)
    assert counts.min() > 20
    assert counts.max() < 90
    assert slot_of((3, -4, 5)) == 28, "the same in every process and release"
