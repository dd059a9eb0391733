"""Times of points in the encodings: how exact they are, what they weigh, and that others do not change."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from firstfix.errors import InvalidScan, UnsupportedFormat
from firstfix.scan.condense import condense
from firstfix.scan.scan import Scan
from firstfix.wire.query import decode_query, encode_query
from firstfix.wire.scan import decode_scan, encode_scan

RNG = np.random.default_rng(2)
AROUND = RNG.uniform(-np.pi, np.pi, 20_000)
POINTS = np.column_stack([9 * np.cos(AROUND), 9 * np.sin(AROUND), RNG.uniform(-1, 2, 20_000)]).astype(
    np.float32
)
SCAN = Scan(POINTS, None, 12.5, (AROUND / (2 * np.pi) * 0.1).astype(np.float32))


def test_points_keep_their_times_to_a_quarter_of_a_millisecond():
    decoded = decode_scan(encode_scan(SCAN))
    assert decoded.time_s.dtype == np.float32
    assert np.abs(decoded.time_s - SCAN.time_s).max() <= 0.5**12
    assert decode_scan(encode_scan(decoded)).time_s.tobytes() == decoded.time_s.tobytes()


@pytest.mark.parametrize("span_s", [0.0, 3e-7, 1e-3, 0.2, 2.0])
def test_any_span_takes_a_byte(span_s):
    times = (np.linspace(-0.5, 0.5, len(SCAN)) * span_s).astype(np.float32)
    decoded = decode_scan(encode_scan(replace(SCAN, time_s=times)))
    assert np.abs(decoded.time_s - times).max() <= max(0.5**21, span_s / 255)


def test_a_range_image_keeps_the_time_of_the_nearest_return():
    behind = Scan(np.concatenate([POINTS * 2, POINTS]), None, None, np.tile(SCAN.time_s, 2))
    behind.time_s[: len(POINTS)] = -0.9
    decoded = decode_scan(encode_scan(behind, form="range_image"))
    azimuth = np.arctan2(decoded.points[:, 1], decoded.points[:, 0])
    off = np.abs(decoded.time_s - azimuth / (2 * np.pi) * 0.1)
    assert np.quantile(off, 0.99) < 0.005


def test_a_compact_scan_keeps_the_mean_time_of_each_voxel():
    compact = condense(SCAN)
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
        with_times = encode_scan(SCAN, form=form)
        without = encode_scan(replace(SCAN, time_s=None), form=form)
        assert 0 < len(with_times) - len(without) < len(SCAN) + 50  # these points are in no order
        kind, start = with_times[5], 6 + 12 + struct.unpack_from("<I", with_times, 14)[0]
        assert (kind, with_times[start:]) == (without[5] + 4, without[6:])


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1.01, -1.01])
def test_times_that_no_scan_has_are_refused(wrong):
    times = SCAN.time_s.copy()
    times[3] = wrong
    for form in ("points", "range_image"):
        with pytest.raises(InvalidScan, match="time"):
            encode_scan(replace(SCAN, time_s=times), form=form)
    with pytest.raises(InvalidScan, match="time"):
        Scan.from_points(POINTS, time_s=times)


def test_one_time_for_each_point():
    for voxel_m in (None, 0.5):
        with pytest.raises(InvalidScan, match="19999 times for 20000"):
            encode_scan(replace(SCAN, time_s=SCAN.time_s[:-1]), voxel_m=voxel_m)
    with pytest.raises(InvalidScan, match="times for 20000 points"):
        Scan.from_points(POINTS, time_s=SCAN.time_s[:-1])
    compact = condense(SCAN)
    with pytest.raises(InvalidScan, match="times for"):
        encode_query(replace(compact, time_s=compact.time_s[:-1]))


def test_points_that_are_dropped_take_their_times_along():
    points, times = POINTS.copy(), SCAN.time_s.copy()
    points[::3, 1], times[::3] = np.nan, np.nan
    kept = np.arange(len(points)) % 3 > 0
    assert np.array_equal(Scan.from_points(points, time_s=times).time_s, SCAN.time_s[kept])


def test_times_without_points_are_unsupported():
    body = bytearray(encode_query(condense(SCAN)))
    for parts in (4, 6, 8):
        body[5] = parts
        with pytest.raises(UnsupportedFormat):
            decode_query(bytes(body))
