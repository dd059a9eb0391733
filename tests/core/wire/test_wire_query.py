"""application/vnd.firstfix.query: decoding inverts encoding, and damaged bodies are refused."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import (
    InvalidOption,
    InvalidScan,
    TooLarge,
)
from firstfix.scan.compact import MAX_COMPACT_POINTS, CompactScan, ScanDescriptor
from firstfix.scan.reduction import COLUMNS, ROWS
from firstfix.wire.query import decode_query, encode_query
from tests.core.wire.samples import compact, described
from tests.every_case import every_case

CELLS = ROWS * COLUMNS
HEADER, COMPACT, DESCRIPTOR = 8, 22, 28  # bytes of the three headers
NOWHERE = np.full(CELLS, np.inf, np.float32)

coordinates = st.floats(-60, 60, width=32)
clouds = hnp.arrays(np.float32, st.tuples(st.integers(0, 60), st.just(3)), elements=coordinates)


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T)]


@given(clouds, st.sampled_from([0.005, 0.01, 0.02, 0.1]))
@settings(max_examples=200, deadline=None)
def test_points_come_back_within_half_the_resolution(cloud, resolution_m):
    back = decode_query(encode_query(CompactScan(cloud, NOWHERE), resolution_m=resolution_m)).points
    assert back.shape == cloud.shape
    assert back.dtype == np.float32
    resolution_m = float(np.float32(resolution_m))
    steps = np.rint(cloud.astype(np.float64) / resolution_m)  # within half of it
    np.testing.assert_array_equal(in_order(np.rint(back / resolution_m)), in_order(steps))
    np.testing.assert_allclose(back, np.rint(back / resolution_m) * resolution_m, atol=1e-5)


@given(hnp.arrays(np.float32, CELLS, elements=st.floats(0.375, 90, width=32), fill=st.just(np.inf)))
@settings(max_examples=100, deadline=None)
def test_ranges_come_back_within_half_a_level(nearest_m):
    back = decode_query(encode_query(CompactScan(np.zeros((0, 3), np.float32), nearest_m))).nearest_m
    there = np.isfinite(nearest_m)
    np.testing.assert_array_equal(np.isfinite(back), there)
    off_m = np.abs(back[there] - nearest_m[there])
    assert (off_m <= 0.0061 * (5 + nearest_m[there])).all()


def test_the_descriptor_comes_back_alone_and_beside_points():
    for query in (described(), compact()):
        sent = query if isinstance(query, ScanDescriptor) else query.described
        back = decode_query(encode_query(query))
        got = back if isinstance(back, ScanDescriptor) else back.described
        assert got.agrees_with(sent.descriptor)
        np.testing.assert_array_equal(got.occupancy, sent.occupancy)
        np.testing.assert_allclose(got.up, sent.up, atol=1e-7)
        assert got.height_m == pytest.approx(sent.height_m, abs=1e-6)
    assert decode_query(encode_query(replace(compact(), described=None))).described is None


def test_a_decoded_query_is_encoded_alike():
    body = encode_query(compact())
    assert encode_query(decode_query(body)) == body


def test_the_bytes_are_what_the_documentation_says():
    """An independent writer, from the layout in the module's docstring: three points in two cells."""
    zstd = zstandard.ZstdCompressor().compress
    q = [(17, -3, 0), (18, -1, 15), (-5, -16, 16)]  # steps of 0.05 m
    cells = [(1, -1, 0), (1, -1, 0), (-1, -1, 1)]
    lowest, size = (-1, -1, 0), (3, 1, 2)
    numbers = [((z - 0) * 1 + (y + 1)) * 3 + (x + 1) for x, y, z in cells]
    assert numbers == [2, 2, 3]
    planes = zstd(bytes([2, 0, 1]) + bytes(9))
    mask = np.zeros(CELLS, np.uint8)
    mask[[7, 9]] = 1
    ranges = zstd(np.packbits(mask).tobytes() + bytes([100, (40 - 100) % 256]))
    low = [v % 16 for point in q for v in point] + [0, 0, 0]
    packed = bytes(a << 4 | b for a, b in zip(low[::2], low[1::2], strict=True))
    body = struct.pack("<4sBBH", b"FFQY", 1, 1, 0)
    body += struct.pack("<fH3h3HHH", 0.05, 3, *lowest, *size, len(planes), len(ranges))
    scan = decode_query(body + planes + ranges + packed)
    np.testing.assert_allclose(scan.points, np.array(q) * 0.05, atol=1e-6)
    assert np.flatnonzero(np.isfinite(scan.nearest_m)).tolist() == [7, 9]
    np.testing.assert_allclose(scan.nearest_m[[7, 9]], 5 * np.expm1(0.012 * np.array([100, 40])), rtol=1e-5)


def test_an_empty_query_comes_back():
    assert len(decode_query(encode_query(CompactScan(np.zeros((0, 3), np.float32), NOWHERE)))) == 0


@every_case("resolution_m", [0, 0.2, float("nan")])
def test_invalid_resolutions_are_refused(resolution_m):
    with pytest.raises(InvalidOption):
        encode_query(compact(), resolution_m=resolution_m)


@every_case(
    ("query", "error"),
    [
        (CompactScan(np.full((1, 3), np.nan, np.float32), NOWHERE), InvalidScan),
        (CompactScan(np.full((1, 3), 5000, np.float32), NOWHERE), InvalidScan),
        (CompactScan(np.zeros((1, 3), np.float32), NOWHERE[1:]), InvalidScan),
        (CompactScan(np.zeros((1, 3), np.float32), -NOWHERE), InvalidScan),
        (CompactScan(np.zeros((MAX_COMPACT_POINTS + 1, 3), np.float32), NOWHERE), TooLarge),
    ],
)
def test_an_invalid_compact_scan_is_refused(query, error):
    with pytest.raises(error):
        encode_query(query)


def test_points_too_far_apart_for_the_resolution_are_refused():
    far = CompactScan(np.array([[-900, -900, -900], [900, 900, 900]], np.float32), NOWHERE)
    with pytest.raises(InvalidScan, match="too far"):
        encode_query(far, resolution_m=0.005)


def test_a_descriptor_agrees_only_with_one_of_the_same_grid_and_layers():
    sent = described()
    assert sent.agrees_with(
        LayeredOccupancy(PolarGrid(20, 60, 23.7), sent.descriptor.edges_m, coefficients=4)
    )
    assert not sent.agrees_with(described(rings=21).descriptor)
    assert not sent.agrees_with(described(edges_m=(0.2, 1.0, 1.8, 3.0, 6.0, 25.0)).descriptor)
