"""Kernels of the scan's room against the NumPy functions in whose place they stand."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

import firstfix.native as native
from firstfix.bit_exact.accelerated import REFERENCES
from firstfix.scan.condense import flat_patches
from firstfix.scan.levelling import directions_about_z, levelling_rotation
from firstfix.scan.reduction import least_of_neighbours, nearest_by_direction
from firstfix.scan_file import read_scan_file
from tests.every_case import every_case
from tests.needs import recorded

SCANS = {
    "street": "kitti_drive0027_street/queries/key_frame_427.laz",
    "hall": "hilti_hall_indoor/queries/scan_044.pcd",
}
R = levelling_rotation(np.array([0.1, -0.05, 0.9]))
EXACT = {
    "within_range": lambda points: (points, 0.5, 30.0),
    "first_in_voxel": lambda points: (points, 0.3),
    "voxel_means": lambda points: (points, 0.3, 0.0005),
    "voxel_mean_times": lambda points: (points, times_of(points), 0.3, 0.0005),
    "rows_by_voxel_hash": lambda points: (points, 0.3, len(points) // 3),
    "turned": lambda points: (points, R),
    "nearest_by_direction": lambda points: (points,),
    "flat_patches": lambda points: (points.astype(np.float64), 0.9),
    "floor_height": lambda points: (points, np.roll(points, 1, axis=0) / 50),
}
# They refuse what is not finite.
FINITE = {"first_in_voxel", "voxel_means", "voxel_mean_times", "rows_by_voxel_hash", "flat_patches"}


@cache
def scan(name: str) -> NDArray[np.float32]:
    return read_scan_file(recorded(SCANS[name])).points


def times_of(points: NDArray[np.floating]) -> NDArray[np.float32]:
    """Times (n,) of a revolution, however many points there are."""
    return np.random.default_rng(len(points)).uniform(-0.1, 0.1, len(points)).astype(np.float32)


def equal(found: Any, wanted: Any) -> bool:
    if isinstance(wanted, tuple):
        return all(map(equal, found, wanted))
    if not isinstance(wanted, np.ndarray):
        return bool(found == wanted)
    return found.dtype == wanted.dtype and np.array_equal(found, wanted, equal_nan=True)


def agrees(kernel: str, *arguments: Any) -> bool:
    with np.errstate(all="ignore"):
        return equal(getattr(native, kernel)(*arguments), REFERENCES[kernel](*arguments))


@pytest.mark.parametrize("place", SCANS)
def test_a_recorded_scan_gives_the_same_bits(place: str):
    points = scan(place)
    for kernel, arguments in EXACT.items():
        assert agrees(kernel, *arguments(points)), kernel
        assert agrees(kernel, *arguments(points[:100])), kernel
    assert agrees("voxel_means", points.astype(np.float64) / 3, 0.1)
    assert agrees("turned", points.astype(np.float64), R)
    assert agrees("least_of_neighbours", nearest_by_direction(points).reshape(90, 180))


METRES = st.one_of(
    st.sampled_from([0.0, -0.0, 0.3, -0.3, 0.6, 1.7, -1.7, 5.0, 12.0]),  # duplicates, lines, edges of voxels
    st.floats(-60, 60, width=32),
    st.floats(-1e5, 1e5, width=32),
)
ANYTHING = st.one_of(METRES, st.floats(width=32))
CLOUD = arrays(np.float32, st.tuples(st.integers(0, 40), st.just(3)), elements=METRES)
WILD_CLOUD = arrays(np.float32, st.tuples(st.integers(0, 40), st.just(3)), elements=ANYTHING)


@settings(max_examples=150)
@given(CLOUD)
def test_any_finite_points_give_the_same_bits(points: NDArray[np.float32]):
    for kernel, arguments in EXACT.items():
        assert agrees(kernel, *arguments(points)), kernel


@settings(max_examples=150)
@given(WILD_CLOUD)
def test_invalid_points_are_refused_or_ignored(points: NDArray[np.float32]):
    finite = points[np.isfinite(points).all(axis=1)]
    for kernel in FINITE:
        arguments = EXACT[kernel](points)
        if len(finite) < len(points):
            with pytest.raises(ValueError, match="not finite"):
                getattr(native, kernel)(*arguments)
    assert equal(native.within_range(points, 0.5, 30.0), native.within_range(finite, 0.5, 30.0))
    assert equal(native.nearest_by_direction(points), native.nearest_by_direction(finite))
    with np.errstate(all="ignore"):
        assert agrees("turned", points, R)


@given(arrays(np.float32, (90, 180), elements=st.floats(0, width=32), fill=st.just(np.float32(np.inf))))
def test_the_least_of_neighbours_of_any_ranges(image: NDArray[np.float32]):
    assert agrees("least_of_neighbours", image)


@given(st.integers(0, 5_000_000), st.integers(0, 3_000))
def test_the_same_rows_by_chance(count: int, at_most: int):
    if count > at_most == 0:
        assert len(native.rows_by_chance(count, 0)) == 0
    else:
        assert agrees("rows_by_chance", count, at_most)


@every_case("corner_m", [(1e15, 0.0, 0.0), (1e9, 1e9, 1e9), (1e300, 0.0, 0.0), (1e308, 1e308, 1e308)])
def test_points_too_far_apart_for_their_voxels_are_refused(corner_m: tuple[float, ...]):
    points = np.array([corner_m, np.negative(corner_m)])
    for kernel in FINITE - {"rows_by_voxel_hash", "voxel_mean_times"}:
        with pytest.raises(ValueError, match="too far apart"):
            getattr(native, kernel)(points, 0.1)
    with pytest.raises(ValueError, match="too far apart"):
        native.voxel_mean_times(points, times_of(points), 0.1)


@every_case("far_m", [1e15, 1e300])
def test_a_voxel_without_a_number_is_refused(far_m: float):
    with pytest.raises(ValueError, match="too far away"):
        native.rows_by_voxel_hash(np.array([[0.0, far_m, 0.0], [0.0, 0.0, 0.0]]), 0.1, 1)


@every_case("voxel_m", [0.0, -1.0, float("nan"), 1e-300])
def test_a_voxel_of_no_size_is_refused(voxel_m: float):
    with pytest.raises(ValueError, match="voxels of this size"):
        native.voxel_means(np.eye(3), voxel_m)
    with pytest.raises(ValueError, match="voxels of this size"):
        native.rows_by_voxel_hash(np.eye(3), voxel_m, 1)


def test_more_voxels_than_32_bits_can_number():
    points = np.random.default_rng(1).uniform(-9e6, 9e6, (3000, 3))
    points = np.concatenate([points, points[::7] + 1e-4])
    assert agrees("voxel_means", points, 50.0)
    assert agrees("flat_patches", points, 50.0)
    keys = np.unique(np.floor(points / 50.0), axis=0, return_index=True)[1]
    assert native.first_in_voxel(points, 50.0).tolist() == np.sort(keys).tolist()


@every_case("layout", ["strided", "reversed", "column-major", "double", "half", "integer"])
def test_another_layout_or_type_is_copied_first(layout: str):
    whole = np.float32([[1, 2, 3], [2, 4, -1], [-3, 1, 2], [7, 8, 1]] * 4)
    points = {
        "strided": np.repeat(whole, 2, axis=0)[::2],
        "reversed": whole[::-1].copy()[::-1],
        "column-major": np.asfortranarray(whole),
        "double": whole.astype(np.float64),
        "half": whole.astype(np.float16),
        "integer": whole.astype(np.int32),
    }[layout]
    assert equal(native.voxel_means(points, 3.0), native.voxel_means(whole, 3.0))
    assert equal(native.within_range(points, 0.5, 8.0), native.within_range(whole, 0.5, 8.0))
    assert equal(native.nearest_by_direction(points), native.nearest_by_direction(whole))
    thirds = np.asfortranarray(whole.astype(np.float64) / 3)  # no digits are lost on the way
    assert agrees("voxel_means", thirds, 0.7)


@every_case(
    "points",
    [np.zeros((3, 2)), np.zeros(3), np.zeros((2, 3, 3)), np.zeros((0,)), [[1.0, 2.0, 3.0]], None, "points"],
)
def test_another_shape_is_refused(points: Any):
    for kernel in ("within_range", "voxel_means", "nearest_by_direction", "turned", "surface_normals"):
        more = {"within_range": (0.5, 30.0), "voxel_means": (0.3,), "turned": (R,)}.get(kernel, ())
        with pytest.raises(TypeError):
            getattr(native, kernel)(points, *more)


def test_the_floor_needs_one_normal_for_each_point():
    with pytest.raises(ValueError, match="one normal for each point"):
        native.floor_height(np.zeros((30, 3)), np.zeros((29, 3)))
    for height_m in (-1.0, 1e9, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="must be in"):
            native.floor_height(np.zeros((30, 3)), np.zeros((30, 3)), height_m)


def unit_normals(seed: int, count: int, dtype: type = np.float32) -> NDArray[np.floating]:
    normals = np.random.default_rng(seed).normal(size=(count, 3)) * [0.2, 1.0, 0.6]
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(dtype)


@every_case("count, dtype", [(0, np.float32), (1, np.float64), (15, np.float32), (2000, np.float64)])
def test_votes_agree_to_six_digits(count: int, dtype: type):
    normals, directions = unit_normals(2, count, dtype), directions_about_z(90.0)
    wanted = REFERENCES["votes"](normals, directions)
    rtol = 1e-6 if count > 100 else 3e-5  # of one vote: its exponent enlarges a last bit
    np.testing.assert_allclose(native.votes(normals, directions), wanted, rtol=rtol, atol=1e-9)


@pytest.mark.parametrize("place", SCANS)
def test_up_is_refined_alike(place: str):
    _, normals = flat_patches(native.voxel_means(scan(place), 0.3), 0.9)
    for voted in directions_about_z(35.0)[::40]:
        wanted = REFERENCES["refined_up"](normals, voted)
        np.testing.assert_allclose(native.refined_up(normals, voted), wanted, rtol=0, atol=1e-12)


@every_case("filled", [np.nan, np.inf, 1e30, 0.0])
def test_invalid_normals_are_harmless(filled: float):
    normals = np.full((40, 3), filled)
    assert native.votes(normals, directions_about_z(35.0)).shape == (len(directions_about_z(35.0)),)
    assert native.refined_up(normals, np.array([0.0, 0.0, 1.0])).shape == (3,)
    assert native.floor_height(normals, normals) is None


def test_kernels_stand_in_the_place_of_the_numpy_functions():
    assert nearest_by_direction is native.nearest_by_direction
    assert least_of_neighbours is native.least_of_neighbours
    assert set(EXACT) | {"votes", "refined_up", "rows_by_chance", "least_of_neighbours"} <= set(REFERENCES)
