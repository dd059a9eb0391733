"""Cells and points that a scan confirms, contradicts, or that the map does not explain: exact geometry."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.engine.changes.cells import cells_of, cells_of_keys, keys_of, slot_of, spot_of
from firstfix.engine.changes.overlay import (
    AGREES,
    CONTRADICTS,
    MAX_POINTS,
    UNEXPLAINED,
    Overlay,
    OverlayMap,
)
from firstfix.engine.changes.sighting import Sighting, sighting_of
from firstfix.errors import CorruptVersion
from firstfix.scan.compact import CompactScan
from firstfix.scan.reduction import nearest_by_direction
from firstfix.scan.scan import Scan
from firstfix.transform import transform_points
from tests.changed_hall import Hall, pose, standing

HALL_M = (16.0, 10.0, 4.0)
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
    return Hall(HALL_M, standing())


@pytest.fixture(scope="module")
def racked() -> Hall:
    return Hall(HALL_M, standing(RACK))


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


def test_a_moved_rack_is_seen_through_and_unexplained(racked: Hall):
    seen = sighted(racked, Hall(HALL_M, standing(AWAY)))
    assert within(cells(seen.contradicted), RACK, 0.3)
    assert within(cells(seen.unexplained), AWAY, 0.3)
    assert min(len(seen.contradicted), len(seen.unexplained)) > 10


def test_places_beyond_the_map_are_not_new(racked: Hall):
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


def test_a_compact_scan_sees_through_the_same_cells(racked: Hall, empty: Hall):
    rng = np.random.default_rng(3)
    scan = empty.scan(empty.simulator(), AT, rng)
    compact = CompactScan(scan.points[:300], nearest_by_direction(scan.points))
    whole, ranges = (sighting_of(racked.index, one, AT) for one in (scan, compact))
    gone, too = cells(whole.contradicted), cells(ranges.contradicted)
    assert within(too, RACK, 0.3)
    assert len(gone & too) > 0.6 * len(gone)


def test_an_empty_scan_shows_nothing(racked: Hall):
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


def laid(mapped: Hall, scan: Scan | CompactScan, T: NDArray[np.float64] = AT) -> Overlay:
    index = mapped.index
    return OverlayMap(index.config, index.surface, index.view).overlay(scan, T)


def shares(found: Overlay) -> list[float]:
    return [float(np.mean(found.kind == kind)) for kind in (AGREES, CONTRADICTS, UNEXPLAINED)]


def test_a_scan_at_its_place_agrees_with_the_map(racked: Hall):
    agrees, contradicts, unexplained = shares(
        laid(racked, racked.scan(racked.simulator(), AT, np.random.default_rng(3)))
    )
    assert agrees > 0.98
    assert contradicts < 0.001
    assert unexplained < 0.02


def test_points_stand_around_the_sensor_along_the_axes_of_the_map(racked: Hall):
    scan = racked.scan(racked.simulator(), AT, np.random.default_rng(3))
    found = laid(racked, scan)
    in_map = transform_points(AT, scan.points)
    np.testing.assert_allclose(found.points + AT[:3, 3], in_map, atol=1e-4)


def test_only_points_of_a_new_thing_are_unexplained(empty: Hall, racked: Hall):
    scan = racked.scan(racked.simulator(), AT, np.random.default_rng(3))
    found = laid(empty, scan)
    in_map = transform_points(AT, scan.points)
    on_rack = ((in_map > np.array(RACK[:3]) - 0.1) & (in_map < np.array(RACK[3:]) + 0.1)).all(axis=1)
    on_rack &= in_map[:, 2] > 0.3
    assert on_rack.sum() > 50
    assert np.mean(found.kind[on_rack] == UNEXPLAINED) > 0.97
    assert np.mean(found.kind[~on_rack] == AGREES) > 0.97


def test_a_wrong_place_contradicts_and_is_unexplained(racked: Hall):
    agrees, contradicts, unexplained = shares(
        laid(racked, racked.scan(racked.simulator(), AT, np.random.default_rng(3)), pose(9.6, 3.2))
    )
    assert agrees < 0.7
    assert contradicts > 0.1
    assert unexplained > 0.02


def test_a_compact_scan_agrees_with_the_map(racked: Hall):
    points = racked.scan(racked.simulator(), AT, np.random.default_rng(3)).points.astype(np.float32)
    agrees, _, _ = shares(laid(racked, CompactScan(points[:500], nearest_by_direction(points))))
    assert agrees > 0.95


def test_a_large_scan_is_thinned(racked: Hall):
    points = np.tile(racked.scan(racked.simulator(), AT, np.random.default_rng(3)).points, (20, 1))
    assert len(laid(racked, Scan.from_points(points)).kind) == MAX_POINTS


def test_a_map_without_its_files_is_corrupt(tmp_path):
    with pytest.raises(CorruptVersion):
        OverlayMap.load(tmp_path)
