"""application/vnd.firstfix.query: decoding inverts encoding, and damaged bodies are refused."""

from __future__ import annotations

import hashlib
import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import (
    FirstfixError,
    InvalidOption,
    InvalidScan,
    MalformedData,
    TooLarge,
    UnsupportedFormat,
)
from firstfix.scan.compact import MAX_COMPACT_POINTS, CompactScan, ScanDescriptor
from firstfix.scan.reduction import COLUMNS, ROWS
from firstfix.wire.query import decode_query, encode_query
from tests.every_case import every_case

CELLS = ROWS * COLUMNS
HEADER, COMPACT, DESCRIPTOR = 8, 22, 28  # bytes of the three headers
NOWHERE = np.full(CELLS, np.inf, np.float32)

coordinates = st.floats(-60, 60, width=32)
clouds = hnp.arrays(np.float32, st.tuples(st.integers(0, 60), st.just(3)), elements=coordinates)


def described(
    rings: int = 20, edges_m: tuple[float, ...] = (0.3, 1.0, 1.8, 3.0, 6.0, 25.0)
) -> ScanDescriptor:
    rng = np.random.default_rng(1)
    descriptor = LayeredOccupancy(PolarGrid(rings, 60, 23.7), edges_m)
    bits = rng.random(descriptor.rows * 60) < 0.1
    return ScanDescriptor(descriptor, np.packbits(bits), np.array([0.0, 0.6, 0.8]), 1.73)


def compact(n: int = 400, seed: int = 0) -> CompactScan:
    """A compact scan of whole numbers, so that the bytes are the same on every machine."""
    rng = np.random.default_rng(seed)
    points = rng.integers(-2000, 2000, (n, 3)) * 0.02
    nearest_m = NOWHERE.copy()
    nearest_m[2000:5000] = rng.integers(1, 60, 3000)
    return CompactScan(points.astype(np.float32), nearest_m, described())


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


def test_what_is_decoded_is_encoded_alike():
    body = encode_query(compact())
    assert encode_query(decode_query(body)) == body


def contents(body: bytes) -> bytes:
    """The body with every frame decompressed: versions of zstd compress differently."""
    plain, at = [body[:HEADER]], HEADER
    if body[5] & 1:
        *_, first, second = struct.unpack_from("<fH3h3HHH", body, at)
        n = struct.unpack_from("<H", body, at + 4)[0]
        plain.append(body[at : at + COMPACT - 4])
        at += COMPACT
        for length in (first, second):
            plain.append(zstandard.decompress(body[at : at + length]))
            at += length
        low = 3 * -(-n // 2)
        plain.append(body[at : at + low])
        at += low
    if body[5] & 2:
        layers = body[at + 1]
        head = DESCRIPTOR + 4 * (layers + 1)
        plain += [body[at : at + 6], body[at + 8 : at + head], zstandard.decompress(body[at + head :])]
    return b"".join(plain)


@every_case(
    ("query", "length", "digest"),
    [
        (compact(), 8051, "ec18794002a59637e190126473d1f89dad38dc8603041b967fef44bf1aa73e99"),
        (compact(401, 3), 8058, "5d982fc282552ae7b0ab42b8b50d2b82977787f3a5c8008414b8b2cbf3e588e2"),
        (described(), 808, "d1620058983f2249d783c88b3fc5b3a6682e9df99b3a13718c273b7499afff70"),
    ],
    ids=["compact", "an odd count", "descriptor"],
)
def test_the_bytes_never_change(query, length, digest):
    plain = contents(encode_query(query))
    assert (len(plain), hashlib.sha256(plain).hexdigest()) == (length, digest)


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


def test_a_query_without_points_is_one():
    assert len(decode_query(encode_query(CompactScan(np.zeros((0, 3), np.float32), NOWHERE)))) == 0


@every_case("resolution_m", [0, 0.2, float("nan")])
def test_senseless_resolutions_are_refused(resolution_m):
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
def test_what_cannot_be_sent_is_refused(query, error):
    with pytest.raises(error):
        encode_query(query)


def test_points_too_far_apart_for_the_resolution_are_refused():
    far = CompactScan(np.array([[-900, -900, -900], [900, 900, 900]], np.float32), NOWHERE)
    with pytest.raises(InvalidScan, match="too far"):
        encode_query(far, resolution_m=0.005)


@every_case("query", [compact(), described()], ids=["compact", "descriptor"])
def test_every_truncation_is_malformed(query):
    body = encode_query(query)
    for length in range(len(body)):
        with pytest.raises(MalformedData):
            decode_query(body[:length])
    with pytest.raises(MalformedData):
        decode_query(body + b"\0")


@given(st.data())
@settings(max_examples=500, deadline=None)
def test_damaged_bytes_give_an_error_or_a_sane_query(data):
    body = bytearray(encode_query(compact(40)))
    for _ in range(data.draw(st.integers(1, 4))):
        body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    try:
        query = decode_query(bytes(body))
    except FirstfixError:
        return
    if isinstance(query, CompactScan):
        assert np.isfinite(query.points).all()
        assert (query.nearest_m >= 0).all()
        query = query.described
    if query is not None:
        assert np.linalg.norm(query.up) == pytest.approx(1)
        assert np.isfinite(query.height_m)


@given(st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_noise_is_an_error(noise):
    for start in (b"", b"FFQY\1\1\0\0", b"FFQY\1\2\0\0"):
        with pytest.raises(FirstfixError):
            decode_query(start + noise)


def with_field(body: bytes, offset: int, form: str, value: object) -> bytes:
    damaged = bytearray(body)
    struct.pack_into("<" + form, damaged, offset, value)
    return bytes(damaged)


@every_case(
    ("offset", "form", "value", "error"),
    [
        (0, "4s", b"FFSC", MalformedData),
        (4, "B", 2, UnsupportedFormat),
        (5, "B", 0, UnsupportedFormat),
        (5, "B", 4, UnsupportedFormat),
        (6, "H", 1, MalformedData),
        (HEADER, "f", 0.0, MalformedData),
        (HEADER, "f", float("nan"), MalformedData),
        (HEADER + 4, "H", 399, MalformedData),
        (HEADER + 4, "H", MAX_COMPACT_POINTS + 1, TooLarge),
        (HEADER + 12, "H", 0, MalformedData),
        (HEADER + 12, "3H", None, MalformedData),
        (HEADER + 18, "H", 3, MalformedData),
        (HEADER + 20, "H", 65535, MalformedData),
    ],
)
def test_each_field_of_the_compact_header_is_checked(offset, form, value, error):
    body = bytearray(encode_query(compact()))
    values = (1, 1, 1) if value is None else (value,)
    struct.pack_into("<" + form, body, offset, *values)
    with pytest.raises(error):
        decode_query(bytes(body))


@every_case(
    ("offset", "form", "value", "error"),
    [
        (0, "B", 2, UnsupportedFormat),
        (1, "B", 0, MalformedData),
        (1, "B", 17, MalformedData),
        (2, "H", 0, MalformedData),
        (2, "H", 21, MalformedData),
        (4, "H", 721, MalformedData),
        (6, "H", 1, MalformedData),
        (8, "f", float("inf"), MalformedData),
        (8, "f", -1.0, MalformedData),
        (12, "f", 0.5, MalformedData),
        (12, "f", float("nan"), MalformedData),
        (24, "f", float("nan"), MalformedData),
        (28, "f", float("nan"), MalformedData),
        (28, "f", 1.5, MalformedData),
        (28, "f", float("-inf"), MalformedData),
    ],
)
def test_each_field_of_the_descriptor_header_is_checked(offset, form, value, error):
    with pytest.raises(error):
        decode_query(with_field(encode_query(described()), HEADER + offset, form, value))


@every_case("declared", [True, False])
def test_a_bomb_is_refused_before_its_memory_is_taken(declared):
    bomb = zstandard.ZstdCompressor(write_content_size=declared).compress(bytes(300_000_000))
    assert len(bomb) < 65_536
    body = encode_query(described())
    at = HEADER + DESCRIPTOR + 4 * 6
    hostile = with_field(body[:at], HEADER + 6, "H", len(bomb)) + bomb
    tracemalloc.start()
    try:
        with pytest.raises(MalformedData):
            decode_query(hostile)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000


def test_a_descriptor_agrees_with_its_like_only():
    sent = described()
    assert sent.agrees_with(
        LayeredOccupancy(PolarGrid(20, 60, 23.7), sent.descriptor.edges_m, coefficients=4)
    )
    assert not sent.agrees_with(described(rings=21).descriptor)
    assert not sent.agrees_with(described(edges_m=(0.2, 1.0, 1.8, 3.0, 6.0, 25.0)).descriptor)
