"""application/vnd.firstfix.scan: decoding inverts encoding, of points, intensity and times."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from firstfix.errors import (
    InvalidOption,
    InvalidScan,
    TooLarge,
    UnsupportedFormat,
)
from firstfix.scan.condense import condense
from firstfix.scan.scan import MAX_POINTS, Scan
from firstfix.wire.query import decode_query, encode_query
from firstfix.wire.scan import decode_scan, encode_scan
from tests.core.wire.samples import street_scan
from tests.every_case import every_case
from tests.needs import recorded

coordinates = st.floats(-1000, 1000, width=32)
clouds = hnp.arrays(np.float32, st.tuples(st.integers(0, 60), st.just(3)), elements=coordinates)


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


def test_an_empty_scan_comes_back():
    assert decode_scan(encode_scan(Scan.from_points(np.empty((0, 3))))).points.shape == (0, 3)


@every_case("kwargs", [{"resolution_m": 0}, {"resolution_m": float("nan")}, {"voxel_m": 0}])
def test_invalid_settings_are_refused(kwargs):
    with pytest.raises(InvalidOption):
        encode_scan(street_scan(), **kwargs)


@every_case("bad", [np.nan, np.inf, 5000])
@every_case("form", ["points", "range_image"])
def test_invalid_coordinates_are_refused(bad, form):
    with pytest.raises(InvalidScan):
        encode_scan(Scan(np.array([[bad, 0, 0]], np.float32)), form=form)
    with pytest.raises(TooLarge):
        encode_scan(Scan(np.zeros((MAX_POINTS + 1, 3), np.float32)), form=form)


def test_a_real_scan_takes_about_200_kib():
    for path in sorted(recorded("kitti_drive0027_street/queries").glob("*.pcd")):
        head, _, rest = path.read_bytes().partition(b"DATA binary\n")
        n = int(head.split(b"POINTS ")[1].split()[0])
        scan = Scan.from_points(np.frombuffer(rest, np.float32, count=3 * n).reshape(n, 3))
        body = encode_scan(scan)
        assert len(body) < 232 * 1024  # 198..230 KiB over the six
        assert len(encode_scan(scan, voxel_m=0.5)) < 44 * 1024
        assert error_m(scan, decode_scan(body)) <= 0.00507


_RNG = np.random.default_rng(2)
AROUND = _RNG.uniform(-np.pi, np.pi, 20_000)
AROUND_POINTS = np.column_stack([9 * np.cos(AROUND), 9 * np.sin(AROUND), _RNG.uniform(-1, 2, 20_000)]).astype(
    np.float32
)
TIMED = Scan(AROUND_POINTS, None, 12.5, (AROUND / (2 * np.pi) * 0.1).astype(np.float32))


def test_points_keep_their_times_to_a_quarter_of_a_millisecond():
    decoded = decode_scan(encode_scan(TIMED))
    assert decoded.time_s.dtype == np.float32
    assert np.abs(decoded.time_s - TIMED.time_s).max() <= 0.5**12
    assert decode_scan(encode_scan(decoded)).time_s.tobytes() == decoded.time_s.tobytes()


@pytest.mark.parametrize("span_s", [0.0, 3e-7, 1e-3, 0.2, 2.0])
def test_any_span_takes_a_byte(span_s):
    times = (np.linspace(-0.5, 0.5, len(TIMED)) * span_s).astype(np.float32)
    decoded = decode_scan(encode_scan(replace(TIMED, time_s=times)))
    assert np.abs(decoded.time_s - times).max() <= max(0.5**21, span_s / 255)


def test_a_range_image_keeps_the_time_of_the_nearest_return():
    behind = Scan(np.concatenate([AROUND_POINTS * 2, AROUND_POINTS]), None, None, np.tile(TIMED.time_s, 2))
    behind.time_s[: len(AROUND_POINTS)] = -0.9
    decoded = decode_scan(encode_scan(behind, form="range_image"))
    azimuth = np.arctan2(decoded.points[:, 1], decoded.points[:, 0])
    off = np.abs(decoded.time_s - azimuth / (2 * np.pi) * 0.1)
    assert np.quantile(off, 0.99) < 0.005


def test_a_compact_scan_keeps_the_mean_time_of_each_voxel():
    compact = condense(TIMED)
    decoded = decode_query(encode_query(compact))
    order = np.lexsort(decoded.points.T)
    again = np.lexsort(np.round(compact.points / np.float32(0.02)).T)
    assert np.abs(np.sort(decoded.time_s) - np.sort(compact.time_s)).max() < 0.0005
    assert np.abs(decoded.points[order] - compact.points[again]).max() < 0.0101
    azimuth = np.arctan2(decoded.points[:, 1], decoded.points[:, 0])
    beside_the_cut = np.abs(azimuth) > 3.1
    off = np.abs(decoded.time_s - azimuth / (2 * np.pi) * 0.1)
    assert off[~beside_the_cut].max() < 0.001


def test_times_add_a_byte_for_each_point_at_most():
    for form in ("points", "range_image"):
        with_times = encode_scan(TIMED, form=form)
        without = encode_scan(replace(TIMED, time_s=None), form=form)
        assert 0 < len(with_times) - len(without) < len(TIMED) + 50  # these points are in no order
        kind, start = with_times[5], 6 + 12 + struct.unpack_from("<I", with_times, 14)[0]
        assert (kind, with_times[start:]) == (without[5] + 4, without[6:])


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1.01, -1.01])
def test_invalid_times_are_refused(wrong):
    times = TIMED.time_s.copy()
    times[3] = wrong
    for form in ("points", "range_image"):
        with pytest.raises(InvalidScan, match="time"):
            encode_scan(replace(TIMED, time_s=times), form=form)
    with pytest.raises(InvalidScan, match="time"):
        Scan.from_points(AROUND_POINTS, time_s=times)


def test_a_scan_needs_one_time_for_each_point():
    for voxel_m in (None, 0.5):
        with pytest.raises(InvalidScan, match="19999 times for 20000"):
            encode_scan(replace(TIMED, time_s=TIMED.time_s[:-1]), voxel_m=voxel_m)
    with pytest.raises(InvalidScan, match="times for 20000 points"):
        Scan.from_points(AROUND_POINTS, time_s=TIMED.time_s[:-1])
    compact = condense(TIMED)
    with pytest.raises(InvalidScan, match="times for"):
        encode_query(replace(compact, time_s=compact.time_s[:-1]))


def test_points_that_are_dropped_take_their_times_along():
    points, times = AROUND_POINTS.copy(), TIMED.time_s.copy()
    points[::3, 1], times[::3] = np.nan, np.nan
    kept = np.arange(len(points)) % 3 > 0
    assert np.array_equal(Scan.from_points(points, time_s=times).time_s, TIMED.time_s[kept])


def test_times_without_points_are_unsupported():
    body = bytearray(encode_query(condense(TIMED)))
    for parts in (4, 6, 8):
        body[5] = parts
        with pytest.raises(UnsupportedFormat):
            decode_query(bytes(body))
