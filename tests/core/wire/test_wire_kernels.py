"""The compiled decoders against those in NumPy: the same bits, the same errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import firstfix.wire.scan  # noqa: F401  (its kernels)
from firstfix import native
from firstfix.bit_exact.accelerated import REFERENCES
from firstfix.errors import FirstfixError
from firstfix.scan.reduction import COLUMNS, ROWS
from firstfix.scan.scan import Scan
from firstfix.wire.query import _LEVEL_EDGES_M, _LEVELS_M
from firstfix.wire.range_image import _cosines_and_sines
from tests.every_case import every_case

SEEDS = st.integers(0, 2**32 - 1)


def outcome(function: Any, *arguments: Any) -> Any:
    """Returns the function's result, or the class and message of its error."""
    try:
        return function(*arguments)
    except FirstfixError as error:
        return type(error), str(error)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if not isinstance(a, np.ndarray):
        return bool(a == b)
    return (
        isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    )


def check(name: str, *arguments: Any) -> Any:
    """Holds the kernel against the NumPy function; what both return."""
    expected, found = outcome(REFERENCES[name], *arguments), outcome(getattr(native, name), *arguments)
    assert same(expected, found), (name, expected, found)
    return found


def octets(rng: np.random.Generator, *shape: int) -> NDArray[np.uint8]:
    return rng.integers(0, 256, shape, np.uint8)


@every_case("dtype", [np.float32, np.float64])
def test_usable_points(dtype: type):
    rng = np.random.default_rng(1)
    for n in (0, 1, 7, 4000):
        rows = rng.normal(0, 600, (n, 5)).astype(dtype)
        odd = [np.nan, np.inf, -np.inf, 1000, -1000, np.nextafter(dtype(1000), dtype(2000)), -0.0, 1e-320]
        rows[rng.random((n, 5)) < 0.2] = dtype(rng.choice(odd))
        for x, y, z in (rows.T[:3], np.ascontiguousarray(rows.T)[2:], rows[::-1].T[1:4], rows[::3].T[:3]):
            check("usable_points", x, y, z)


@pytest.mark.parametrize("dtype", [">f4", ">f8", "<f8", "i2", "u8", "f2"])
def test_a_column_of_any_type_is_read(dtype: str):
    """Packed records: the numbers are not aligned, and some are in the other byte order."""
    record = np.dtype([("ring", "u1"), ("x", dtype), ("y", dtype), ("z", "<f4")])
    rows = np.zeros(50, record)
    for number, axis in enumerate("xyz"):
        rows[axis] = np.arange(50) * (number + 1)
    rows["z"][7] = np.nan
    scan = Scan.from_columns(rows["x"], rows["y"], rows["z"], np.arange(50))
    kept = np.delete(np.arange(50), 7)
    assert np.array_equal(scan.points, np.outer(kept, [1, 2, 3]).astype(np.float32))
    assert scan.intensity is not None
    assert np.array_equal(scan.intensity, kept.astype(np.float32))


def test_coordinates_within_a_limit():
    for value in (0, 1001, np.nextafter(np.float32(1001), np.float32(0)), -1002, np.nan, np.inf):
        points = np.zeros((9, 3), np.float32)
        points[4, 1] = value
        check("all_within", points, 1001.0)
        check("all_within", points, 1000.9999)
    assert check("all_within", np.empty((0, 3), np.float32), 1.0)


@given(SEEDS, st.sampled_from([2, 4]), st.sampled_from([0, 1, 2, 511, 512, 513, 3000]))
def test_points_of_planes(seed: int, coordinate_bytes: int, n: int):
    rng = np.random.default_rng(seed)
    planes = octets(rng, 3 * coordinate_bytes + 2, n)
    check("points_of_planes", planes[:-2], rng.uniform(1e-4, 1), rng.normal(0, 300, 3))
    for width in (1, 2):
        check("intensity_of_planes", planes[-width:], rng.normal(), rng.normal(0, 100))


@given(SEEDS, st.integers(0, 300), st.sampled_from([0.0, 0.1, 1.0]), st.integers(-3, 3))
def test_range_image_points(seed: int, count: int, wide: float, more: int):
    """Also where the bytes do not fit the count, or the grid is too small."""
    rng = np.random.default_rng(seed)
    halves = rng.integers(0, 15, count + count % 2).astype(np.uint8)
    halves[rng.random(len(halves)) < wide] = 15
    if count % 2 and rng.random() < 0.9:
        halves[-1] = 0
    ranges = rng.integers(1, 255, count).astype(np.uint8) & 0xFE  # positive
    ranges[rng.random(count) < wide] = 255
    wide_gaps, wide_ranges = int((halves[:count] == 15).sum()), int((ranges == 255).sum())
    planes = np.zeros((3, max(wide_gaps, 0)), np.uint8)
    planes[0] = octets(rng, wide_gaps)
    gaps = np.concatenate([halves[::2] << 4 | halves[1::2], planes.ravel(), octets(rng, max(more, 0))])
    ranges = np.concatenate([ranges, octets(rng, max(2 * wide_ranges + min(more, 0), 0))])
    columns, rows = int(rng.choice([4, 63, 4096])), int(rng.choice([2, 80, 1024]))
    azimuths = _cosines_and_sines(columns, 2 * np.pi, np.pi)
    elevations = _cosines_and_sines(rows, np.pi, np.pi / 2)
    check("range_image_points", gaps, ranges, count, rng.uniform(0.005, 1), azimuths, elevations)


@given(SEEDS, st.integers(0, 400), st.sampled_from([1, 40, 2000]))
def test_compact_points(seed: int, n: int, side: int):
    rng = np.random.default_rng(seed)
    size = rng.integers(1, side + 1, 3)
    number = np.sort(rng.integers(0, size.prod() + (rng.random() < 0.2), n))
    planes = np.diff(number, prepend=0).astype("<u4").view(np.uint8).reshape(n, 4).T.copy()
    lowest = rng.integers(-side, side, 3)
    check("compact_points", planes, octets(rng, -(-n // 2) * 3), lowest, size, rng.uniform(0.005, 0.1))


@given(SEEDS, st.integers(0, 400), st.sampled_from([0.1, 40.0, 1000.0]))
def test_compact_planes(seed: int, n: int, reach_m: float):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-reach_m, reach_m, (n, 3)).astype(np.float32)
    points[rng.random(n) < 0.1] = points[:1]  # equal cells keep their order
    check("compact_planes", points, rng.uniform(0.005, 0.1))


@given(SEEDS, st.sampled_from([0.0, 0.3, 1.0]))
def test_levels_of_ranges(seed: int, returned: float):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 3000))
    ranges = rng.choice([0.0, 0.31, 7.0, 104.9, 2000.0], count) + rng.exponential(
        rng.choice([0, 0.1, 30]), count
    )
    on_edges = rng.random(count) < 0.2
    ranges[on_edges] = rng.choice(_LEVEL_EDGES_M, on_edges.sum())
    ranges[rng.random(count) >= returned] = np.inf
    check("levels_of_ranges", ranges.astype(np.float32), _LEVEL_EDGES_M)


def test_points_that_a_kernel_cannot_encode_are_refused():
    few = np.zeros((3, 3), np.float32)
    for points, step_m in (
        (np.zeros((10_001, 3), np.float32), 0.02),
        (few + np.float32(1001), 0.02),
        (few * np.float32(np.nan), 0.02),
        (few, 0.003),
        (few, np.nan),
    ):
        with pytest.raises(ValueError, match=r"10,000|1000 m|a step"):
            native.compact_planes(points, step_m)


@given(SEEDS, st.integers(-2, 2))
def test_ranges_of_levels(seed: int, more: int):
    rng = np.random.default_rng(seed)
    directions = ROWS * COLUMNS
    mask = octets(rng, -(-directions // 8))
    returned = int(np.unpackbits(mask)[:directions].sum())
    content = np.concatenate([mask, octets(rng, returned + more * int(rng.random() < 0.3))])
    check("ranges_of_levels", content, _LEVELS_M, directions)
