"""A scan as a range image: decoded points are close to the encoded ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from firstfix.errors import InvalidOption
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.wire.range_image import COLUMNS, ROWS
from firstfix.wire.scan import decode_scan, encode_scan
from tests.core.wire.samples import body_of, image_of, spinning
from tests.every_case import every_case
from tests.needs import recorded

coordinates = st.floats(-900, 900, width=32)
clouds = hnp.arrays(np.float32, st.tuples(st.integers(0, 80), st.just(3)), elements=coordinates)


def directions(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Azimuth and elevation in radians, and range."""
    x, y, z = points.astype(np.float64).T
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)), np.sqrt(x * x + y * y + z * z)


def cells_of(points: np.ndarray) -> np.ndarray:
    azimuth, elevation, _ = directions(points)
    column = np.floor((azimuth / (2 * np.pi) + 0.5) * COLUMNS).astype(int) % COLUMNS
    row = np.minimum(np.floor((elevation / np.pi + 0.5) * ROWS).astype(int), ROWS - 1)
    return row * COLUMNS + column


def away_from_edges(points: np.ndarray) -> np.ndarray:
    """Returns whether double and float arithmetic certainly give the same cell."""
    azimuth, elevation, _ = directions(points)
    places = np.stack([azimuth * (COLUMNS / (2 * np.pi)), elevation * (ROWS / np.pi)])
    return (np.abs(places - np.rint(places)) > 0.01).all(axis=0)


@given(clouds, st.sampled_from([0.025, 0.05, 0.3, 1.0]))
@settings(max_examples=200, deadline=None)
def test_every_return_is_the_nearest_of_a_direction(cloud, resolution_m):
    """Every return is near a point. Every point has a return in its cell that is not further away."""
    scan = Scan.from_points(cloud)
    back = decode_scan(image_of(scan, resolution_m)).points
    _, _, ranges = directions(back)
    reach = np.hypot(np.pi / COLUMNS, np.pi / (2 * ROWS)) * 1.001  # to a cell's corner
    for point, range_m in zip(back, ranges, strict=True):
        off = np.linalg.norm(scan.points.astype(np.float64) - point, axis=1).min()
        assert off <= resolution_m / 2 + reach * (range_m + resolution_m) + 1e-4
    assert len(np.unique(cells_of(back))) == len(back)
    nearest = dict(zip(cells_of(back).tolist(), ranges.tolist(), strict=True))
    inside = scan.points[away_from_edges(scan.points)]
    _, _, given_m = directions(inside)
    for cell, range_m in zip(cells_of(inside).tolist(), given_m.tolist(), strict=True):
        if resolution_m * 0.51 < range_m < resolution_m * 65_535:
            assert nearest[cell] <= range_m + resolution_m * 0.51


@given(clouds)
@settings(max_examples=100, deadline=None)
def test_a_decoded_image_is_encoded_alike(cloud):
    body = image_of(Scan.from_points(cloud), 0.05)
    assert image_of(decode_scan(body), 0.05) == body


def test_the_order_of_the_points_does_not_matter():
    scan = spinning()
    mixed = np.random.default_rng(1).permutation(len(scan))
    twice = np.concatenate([scan.points[mixed], scan.points])
    assert image_of(Scan(twice, None, scan.stamp_s)) == image_of(scan)


def test_a_sweep_comes_back_row_by_row():
    scan = spinning()
    back = decode_scan(image_of(scan))
    assert len(back) == len(scan)
    assert (np.diff(cells_of(back.points)) > 0).all()
    assert back.stamp_s == scan.stamp_s
    there, here = (
        points[np.lexsort(np.round(directions(points)[:2], 2))] for points in (scan.points, back.points)
    )
    assert np.linalg.norm(there - here, axis=1).max() < 0.0125 + 29 * np.hypot(np.pi / 4096, np.pi / 2048)


def test_poles_and_the_seam_come_back_and_the_origin_does_not():
    points = [[0, 0, 5], [0, 0, -5], [-2, 0, 0], [-2, -0.0, 0], [-2, 1e-30, 0], [-2, 0.01, 0]]
    points += [[0, 0, 0], [0.01, 0, 0]]
    back = decode_scan(image_of(Scan.from_points(points))).points
    # one cell behind the seam and one before it; nothing at the origin, and nothing of a hundredth of a metre
    assert np.round(back, 1).tolist() == [[0, 0, -5], [-2, 0, 0], [-2, 0, 0], [0, 0, 5]]


def test_returns_beyond_its_reach_are_left_out():
    points = [[300, 0, 0], [0, 340, 0]]
    assert len(decode_scan(image_of(Scan.from_points(points), 0.005))) == 1
    assert len(decode_scan(image_of(Scan.from_points(points), 0.01))) == 2


def test_the_intensity_is_left_out():
    scan = Scan.from_points([[1, 2, 3]], [7])
    assert decode_scan(image_of(scan)).intensity is None


@every_case("resolution_m", [0.0049, 0.0, 1.01, float("nan"), -1.0])
def test_invalid_settings_are_refused(resolution_m):
    with pytest.raises(InvalidOption):
        image_of(spinning(), resolution_m)
    with pytest.raises(InvalidOption, match="smoke"):
        encode_scan(spinning(), form="smoke")


def test_the_bytes_are_what_the_documentation_says():
    """On a grid of 8 by 4 cells, at half a metre: cells 0, 1, 17 and 31; 4, 4.5, 204.5 and 4 m."""
    body = body_of(8, 4, [0, 0, 15, 13], [15], [16, 2, 255, 255], [800, 801])
    scan = decode_scan(body)
    assert scan.stamp_s == 7.5
    azimuth, elevation, ranges = directions(scan.points)
    np.testing.assert_allclose(ranges, [4, 4.5, 204.5, 4], rtol=1e-6)
    np.testing.assert_allclose(np.degrees(azimuth), [-157.5, -112.5, -112.5, 157.5], rtol=1e-6)
    np.testing.assert_allclose(np.degrees(elevation), [-67.5, -67.5, 22.5, 67.5], rtol=1e-6)


def test_the_largest_grid_is_read():
    scan = decode_scan(body_of(65_535, 256, [15], [65_535 * 256 - 1], [2], []))
    assert scan.points.shape == (1, 3)


@every_case(("folder", "returns"), [("kitti_drive0027_street", 0.98), ("hilti_hall_indoor", 0.99)])
def test_a_real_scan_takes_under_90_kb(folder, returns):
    for path in sorted(recorded(f"{folder}/queries").glob("*.pcd")):
        scan = read_scan_file(path)
        body = image_of(scan)
        assert len(body) < 90_000
        assert len(decode_scan(body)) >= returns * len(scan)
