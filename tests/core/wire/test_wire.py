"""application/vnd.firstfix.scan: decoding inverts encoding, and damaged bodies are refused."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from firstfix.errors import (
    FirstfixError,
    InvalidOption,
    InvalidScan,
    MalformedData,
    TooLarge,
    UnsupportedFormat,
)
from firstfix.scan.scan import MAX_POINTS, Scan
from firstfix.wire.scan import decode_scan, encode_scan
from tests.every_case import every_case
from tests.needs import recorded

HEADER_BYTES = 64

coordinates = st.floats(-1000, 1000, width=32)
clouds = hnp.arrays(np.float32, st.tuples(st.integers(0, 60), st.just(3)), elements=coordinates)


def street_scan(seed: int = 0, n: int = 5000) -> Scan:
    rng = np.random.default_rng(seed)
    azimuth = np.sort(rng.uniform(-np.pi, np.pi, n))
    ranges = 20 + 5 * np.sin(4 * azimuth) + rng.normal(0, 0.02, n)
    points = np.stack([ranges * np.cos(azimuth), ranges * np.sin(azimuth), rng.uniform(-2, 5, n)], axis=1)
    return Scan.from_points(points, rng.integers(0, 256, n), 1_700_000_000.25)


def error_m(scan: Scan, back: Scan) -> float:
    return float(np.abs(back.points.astype(np.float64) - scan.points).max(initial=0))


@given(clouds, st.sampled_from([0.001, 0.01, 0.02, 0.1]))
@settings(max_examples=200, deadline=None)
def test_coordinates_come_back_within_half_the_resolution(cloud, resolution_m):
    scan = Scan.from_points(cloud)
    back = decode_scan(encode_scan(scan, resolution_m=resolution_m))
    assert back.points.shape == scan.points.shape
    assert back.points.dtype == np.float32
    float32_step_m = 6.2e-5  # of a coordinate of 1000 m
    assert error_m(scan, back) <= resolution_m / 2 + float32_step_m


@given(
    hnp.arrays(
        np.float32,
        st.integers(1, 50),
        elements=st.floats(width=32, allow_nan=False, allow_infinity=False),
    )
)
@settings(max_examples=200, deadline=None)
def test_any_intensity_comes_back_within_a_step_of_its_range(intensity):
    scan = Scan.from_points(np.zeros((len(intensity), 3)), intensity)
    back = decode_scan(encode_scan(scan)).intensity
    wanted = np.clip(intensity.astype(np.float64), -1e30, 1e30)
    step = (wanted.max() - wanted.min()) / 65_535
    float32_steps = 4 * np.abs(wanted).max() * np.finfo(np.float32).eps + 1e-44
    assert np.abs(back - wanted).max() <= step / 2 + float32_steps


@every_case("top", [255, 65_535])
def test_whole_number_intensities_are_exact(top):
    intensity = np.random.default_rng(1).integers(0, top + 1, 999)
    intensity[0] = top
    scan = Scan.from_points(np.zeros((999, 3)), intensity)
    np.testing.assert_array_equal(decode_scan(encode_scan(scan)).intensity, intensity)


def test_an_intensity_that_is_not_a_number_does_not_cost_the_scan():
    scan = Scan.from_points(np.zeros((3, 3)), [np.nan, 0.25, np.inf])
    back = decode_scan(encode_scan(scan)).intensity
    assert np.isfinite(back).all()


def test_stamp_and_absence_of_extras_come_back():
    assert decode_scan(encode_scan(street_scan())).stamp_s == 1_700_000_000.25
    bare = decode_scan(encode_scan(Scan.from_points([[1, 2, 3]])))
    assert bare.stamp_s is None
    assert bare.intensity is None


@every_case(
    ("points", "coordinate_bytes"),
    [
        ([[327.6, 0, 0], [-327.6, 0, 0]], 2),
        ([[400, 0, 0], [900, 0, 0]], 2),  # far, but held by moving the origin
        ([[-900, 0, 0], [900, 3, -20]], 4),
    ],
)
def test_far_points_are_kept(points, coordinate_bytes):
    scan = Scan.from_points(points)
    body = encode_scan(scan)
    assert body[6] == coordinate_bytes
    assert error_m(scan, decode_scan(body)) <= 0.00507


def test_the_voxel_filter_keeps_one_measured_point_a_cell():
    scan = street_scan()
    back = decode_scan(encode_scan(scan, voxel_m=0.5))
    cells = {tuple(cell) for cell in np.floor(scan.points.astype(np.float64) / 0.5).astype(int)}
    assert len(back) == len(cells) < len(scan)
    nearest = np.abs(scan.points[:, None] - back.points[None, :50]).max(axis=2).min(axis=0)
    assert nearest.max() <= 0.00507
    assert len(back.intensity) == len(back)


def test_the_bytes_are_what_the_documentation_says():
    """An independent writer, from the layout in the module's docstring."""
    q = np.array([[100, -200, 3], [32_000, -32_000, 4], [-32_000, 32_000, 5]], np.int64)
    d = np.diff(q, axis=0, prepend=np.zeros((1, 3), np.int64)) % 65_536
    planes = [
        np.asarray((d[:, axis] >> shift) & 255, np.uint8).tobytes() for axis in range(3) for shift in (0, 8)
    ]
    header = struct.pack("<4sBBBBIId3ddff", b"FFSC", 1, 1, 2, 1, 3, 0, 0.02, 1, 2, 3, 7.5, 2.0, 10.0)
    body = header + zstandard.ZstdCompressor().compress(b"".join(planes) + bytes([0, 1, 255]))
    scan = decode_scan(body)
    np.testing.assert_allclose(scan.points, q * 0.02 + [1, 2, 3], atol=1e-4)
    np.testing.assert_array_equal(scan.intensity, [10, 12, 520])
    assert scan.stamp_s == 7.5


def test_a_scan_without_points_is_a_scan():
    assert decode_scan(encode_scan(Scan.from_points(np.empty((0, 3))))).points.shape == (0, 3)


@every_case("kwargs", [{"resolution_m": 0}, {"resolution_m": float("nan")}, {"voxel_m": 0}])
def test_senseless_settings_are_refused(kwargs):
    with pytest.raises(InvalidOption):
        encode_scan(street_scan(), **kwargs)


@every_case("bad", [np.nan, np.inf, 5000])
def test_coordinates_that_skipped_the_check_are_refused(bad):
    with pytest.raises(InvalidScan):
        encode_scan(Scan(np.array([[bad, 0, 0]], np.float32)))


def test_every_truncation_is_malformed():
    body = encode_scan(street_scan(n=300))
    for length in range(len(body)):
        with pytest.raises(MalformedData):
            decode_scan(body[:length])


def test_bytes_after_the_end_are_malformed():
    body = encode_scan(street_scan(n=300))
    for extra in (b"\0", body[HEADER_BYTES:]):
        with pytest.raises(MalformedData):
            decode_scan(body + extra)


def test_every_bit_flip_of_the_frame_is_found():
    body = encode_scan(street_scan(n=40))
    for position in range(HEADER_BYTES, len(body)):
        for bit in range(8):
            damaged = bytearray(body)
            damaged[position] ^= 1 << bit
            try:
                back = decode_scan(bytes(damaged))
            except FirstfixError:
                continue
            # zstd has bits without meaning (its reserved ones are ignored): the points must be the same
            np.testing.assert_array_equal(back.points, decode_scan(body).points)


@given(st.data())
@settings(max_examples=400, deadline=None)
def test_a_damaged_header_gives_an_error_or_a_sane_scan(data):
    body = bytearray(encode_scan(street_scan(n=40)))
    for _ in range(data.draw(st.integers(1, 4))):
        body[data.draw(st.integers(0, HEADER_BYTES + 12))] = data.draw(st.integers(0, 255))
    try:
        scan = decode_scan(bytes(body))
    except FirstfixError:
        return
    assert np.isfinite(scan.points).all()
    assert np.isfinite(scan.intensity).all()


@given(st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_noise_is_an_error(noise):
    with pytest.raises(FirstfixError):
        decode_scan(noise)


def with_field(body: bytes, offset: int, form: str, value: object) -> bytes:
    damaged = bytearray(body)
    struct.pack_into("<" + form, damaged, offset, value)
    return bytes(damaged)


@every_case(
    ("offset", "form", "value", "error"),
    [
        (0, "4s", b"LASF", MalformedData),
        (4, "B", 2, UnsupportedFormat),
        (5, "B", 0, UnsupportedFormat),
        (5, "B", 3, UnsupportedFormat),
        (6, "B", 3, MalformedData),
        (7, "B", 4, MalformedData),
        (8, "I", 39, MalformedData),
        (8, "I", MAX_POINTS + 1, TooLarge),
        (8, "I", 2**32 - 1, TooLarge),
        (12, "I", 1, MalformedData),
        (16, "d", 0.0, MalformedData),
        (16, "d", float("nan"), MalformedData),
        (24, "d", float("inf"), MalformedData),
        (48, "d", float("inf"), MalformedData),
        (56, "f", float("inf"), MalformedData),
        (60, "f", float("nan"), MalformedData),
    ],
)
def test_each_header_field_is_checked(offset, form, value, error):
    with pytest.raises(error):
        decode_scan(with_field(encode_scan(street_scan(n=40)), offset, form, value))


def test_coordinates_out_of_range_are_malformed():
    body = encode_scan(Scan.from_points([[100, 0, 0]]))
    with pytest.raises(MalformedData, match="beyond"):
        decode_scan(with_field(body, 16, "d", 0.5))  # 10000 steps of 0.5 m


@every_case("declared", [True, False])
def test_a_bomb_is_refused_before_its_memory_is_taken(declared):
    bomb = zstandard.ZstdCompressor(write_content_size=declared).compress(bytes(300_000_000))
    body = encode_scan(street_scan(n=40))[:HEADER_BYTES] + bomb
    tracemalloc.start()
    try:
        with pytest.raises(MalformedData):
            decode_scan(body)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000


def test_a_real_scan_takes_about_200_kib():
    for path in sorted(recorded("kitti_drive0027_street/queries").glob("*.pcd")):
        head, _, rest = path.read_bytes().partition(b"DATA binary\n")
        n = int(head.split(b"POINTS ")[1].split()[0])
        scan = Scan.from_points(np.frombuffer(rest, np.float32, count=3 * n).reshape(n, 3))
        body = encode_scan(scan)
        assert len(body) < 232 * 1024  # 198..230 KiB over the six
        assert len(encode_scan(scan, voxel_m=0.5)) < 44 * 1024
        assert error_m(scan, decode_scan(body)) <= 0.00507
