"""The overlay: returns on, through and beside the map, in halls whose things have moved."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.engine.changes.overlay import (
    AGREES,
    CONTRADICTS,
    MOST_POINTS,
    UNEXPLAINED,
    Overlay,
    OverlayMap,
)
from firstfix.errors import CorruptVersion
from firstfix.scan.compact import CompactScan
from firstfix.scan.reduction import nearest_by_direction
from firstfix.scan.scan import Scan
from firstfix.transform import transform_points
from tests.changed_hall import Hall, pose, standing

SIZE_M = (16.0, 10.0, 4.0)
RACK = (9.2, 4.2, 0.0, 10.3, 6.3, 2.3)
AT = pose(4.1, 5.2)


@pytest.fixture(scope="module")
def empty() -> Hall:
    return Hall(SIZE_M, standing())


@pytest.fixture(scope="module")
def racked() -> Hall:
    return Hall(SIZE_M, standing(RACK))


def laid(mapped: Hall, scan: Scan | CompactScan, T: NDArray[np.float64] = AT) -> Overlay:
    index = mapped.index
    return OverlayMap(index.config, index.surface, index.view).overlay(scan, T)


def scan_of(hall: Hall) -> Scan:
    return hall.scan(hall.simulator(), AT, np.random.default_rng(3))


def shares(found: Overlay) -> list[float]:
    return [float(np.mean(found.kind == kind)) for kind in (AGREES, CONTRADICTS, UNEXPLAINED)]


def test_a_scan_at_its_place_agrees(racked: Hall):
    agrees, contradicts, unexplained = shares(laid(racked, scan_of(racked)))
    assert agrees > 0.98
    assert contradicts < 0.001
    assert unexplained < 0.02


def test_points_stand_around_the_sensor_along_the_axes_of_the_map(racked: Hall):
    scan = scan_of(racked)
    found = laid(racked, scan)
    in_map = transform_points(AT, scan.points)
    np.testing.assert_allclose(found.points + AT[:3, 3], in_map, atol=1e-4)


def test_what_has_come_is_unexplained_and_nothing_else_is(empty: Hall, racked: Hall):
    scan = scan_of(racked)
    found = laid(empty, scan)
    in_map = transform_points(AT, scan.points)
    on_rack = ((in_map > np.array(RACK[:3]) - 0.1) & (in_map < np.array(RACK[3:]) + 0.1)).all(axis=1)
    on_rack &= in_map[:, 2] > 0.3
    assert on_rack.sum() > 50
    assert np.mean(found.kind[on_rack] == UNEXPLAINED) > 0.97
    assert np.mean(found.kind[~on_rack] == AGREES) > 0.97


def test_a_wrong_place_contradicts_and_is_unexplained(racked: Hall):
    agrees, contradicts, unexplained = shares(laid(racked, scan_of(racked), pose(9.6, 3.2)))
    assert agrees < 0.7
    assert contradicts > 0.1
    assert unexplained > 0.02


def test_a_compact_scan_is_laid_too(racked: Hall):
    points = scan_of(racked).points.astype(np.float32)
    agrees, _, _ = shares(laid(racked, CompactScan(points[:500], nearest_by_direction(points))))
    assert agrees > 0.95


def test_a_large_scan_is_thinned(racked: Hall):
    points = np.tile(scan_of(racked).points, (20, 1))
    assert len(laid(racked, Scan.from_points(points)).kind) == MOST_POINTS


def test_damaged_files_are_said_to_be(tmp_path):
    with pytest.raises(CorruptVersion):
        OverlayMap.load(tmp_path)
