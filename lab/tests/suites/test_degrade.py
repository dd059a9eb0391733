"""Scans made worse: what is gone, and that the rest and the pose still fit."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.scan.scan import Scan
from firstfix.sensor import preset
from firstfix.transform import make_transform, rotation_angle_deg, rotation_z, transform_points
from firstfix_lab.suites.real.degrade import every_second_ring, ring_of, tilted, without_sectors

SENSOR = preset("os0-64")
BEAMS, COLUMNS = 64, 1024


@pytest.fixture
def scan() -> Scan:
    """Beam by beam, as the sensor casts; intensity is the beam's number."""
    away_m = np.random.default_rng(1).uniform(2, 20, (BEAMS * COLUMNS, 1))
    return Scan.from_points(SENSOR.directions() * away_m, np.repeat(np.arange(BEAMS), COLUMNS))


def shuffled(scan: Scan) -> Scan:
    order = np.random.default_rng(2).permutation(len(scan))
    assert scan.intensity is not None
    return Scan(scan.points[order], scan.intensity[order])


@pytest.mark.parametrize("order", [lambda scan: scan, shuffled], ids=["ring by ring", "in any order"])
def test_rings_are_the_beams(scan, order):
    there = order(scan)
    np.testing.assert_array_equal(ring_of(there.points, SENSOR), there.intensity)


def test_rings_are_found_where_beams_are_a_little_off(scan):
    leaning = transform_points(
        make_transform(Rotation.from_euler("y", 0.1, degrees=True).as_matrix(), [0, 0, 0]), scan.points
    )
    there = shuffled(Scan.from_points(leaning, scan.intensity))
    assert np.mean(ring_of(there.points, SENSOR) == there.intensity) > 0.999


def test_half_of_the_beams_are_left(scan):
    half = every_second_ring(shuffled(scan), SENSOR)
    assert len(half) == len(scan) // 2
    np.testing.assert_array_equal(np.unique(half.intensity), np.arange(0, BEAMS, 2))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_sectors_take_their_share_and_leave_the_rest_whole(scan, share):
    rest = without_sectors(scan, share, np.random.default_rng(3))
    assert len(rest) == len(scan) - round(share * len(scan))
    whole = {tuple(point) for point in scan.points[::97]}
    kept = {tuple(point) for point in rest.points} & whole
    assert len(kept) == pytest.approx((1 - share) * len(whole), abs=0.05 * len(whole))
    azimuth_deg = np.degrees(np.arctan2(rest.points[:, 1], rest.points[:, 0]))
    filled = np.histogram(azimuth_deg, bins=360, range=(-180, 180))[0] > 0
    assert filled.mean() < 1 - share + 0.03


def test_a_tilted_scan_lies_where_it_lay(scan):
    T_map_sensor = make_transform(rotation_z(0.7), [3, 4, 1])
    worse, T_map_tilted = tilted(scan, T_map_sensor, 5.0, np.random.default_rng(4))
    np.testing.assert_allclose(
        transform_points(T_map_tilted, worse.points), transform_points(T_map_sensor, scan.points), atol=1e-4
    )
    assert rotation_angle_deg(T_map_sensor[:3, :3].T @ T_map_tilted[:3, :3]) == pytest.approx(7.07, abs=0.02)
