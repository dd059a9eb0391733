from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge
from firstfix.formats.pcd import decode_pcd
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from tests.core.formats.cloud_files import pcd, pcd_body, pcd_header, random_cloud
from tests.every_case import every_case

ENCODINGS = ("ascii", "binary", "binary_compressed")


@every_case("encoding", ENCODINGS)
@every_case("dtype", ["f4", "f8"])
def test_every_column_comes_back(encoding, dtype):
    cloud = random_cloud(200, dtype)
    read = decode_pcd(pcd(cloud, encoding), SCAN_LIMITS)
    assert list(read.columns) == ["x", "y", "z", "intensity", "ring"]
    for name in cloud.dtype.names:
        np.testing.assert_array_equal(read.columns[name], cloud[name])
    np.testing.assert_array_equal(read.intensity, cloud["intensity"])


@every_case("encoding", ENCODINGS)
def test_double_coordinates_of_utm_size_are_exact(encoding):
    cloud = random_cloud(100, "f8")
    cloud["x"] += 512_345.678
    cloud["y"] += 5_403_210.123
    read = decode_pcd(pcd(cloud, encoding), SCAN_LIMITS)
    np.testing.assert_array_equal(read.xyz, np.stack([cloud[a] for a in "xyz"], axis=1))


@every_case("encoding", ENCODINGS)
def test_nan_rows_are_kept(encoding):
    cloud = random_cloud(10)
    cloud["y"][3] = np.nan
    read = decode_pcd(pcd(cloud, encoding), SCAN_LIMITS)
    assert len(read) == 10
    assert np.isnan(read.xyz[3, 1])
    assert np.isnan(read.xyz).sum() == 1


@every_case("kind", ["i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8"])
@every_case("encoding", ENCODINGS)
def test_every_number_type(kind, encoding):
    cloud = np.zeros(3, [("x", "<f4"), ("extra", "<" + kind), ("y", "<f4"), ("z", "<f8")])
    cloud["extra"], cloud["z"] = [1, 2, 100], [7, 8, 9]
    read = decode_pcd(pcd(cloud, encoding), SCAN_LIMITS)
    np.testing.assert_array_equal(read.columns["extra"], [1, 2, 100])
    np.testing.assert_array_equal(read.columns["z"], [7, 8, 9])


@every_case("encoding", ["binary", "binary_compressed", "ascii"])
def test_padding_and_fields_of_several_numbers_are_stepped_over(encoding):
    fields = [
        ("x", "<f4"),
        ("y", "<f4"),
        ("_", "u1", 4),
        ("z", "<f4"),
        ("histogram", "<f4", 3),
        ("ring", "<u2"),
    ]
    cloud = np.zeros(5, fields)
    cloud["x"], cloud["z"], cloud["ring"] = np.arange(5), np.arange(5) * 10, np.arange(5) + 3
    cloud["_"], cloud["histogram"] = 255, 1.5
    header = pcd_header(cloud, encoding, SIZE="4 4 1 4 4 2", TYPE="F F U F F U", COUNT="1 1 4 1 3 1")
    if encoding == "ascii":
        body = b"".join(b"%d 0 255 255 255 255 %d 1.5 1.5 1.5 %d\n" % (i, 10 * i, i + 3) for i in range(5))
    else:
        body = pcd_body(cloud, encoding)
    read = decode_pcd(header + body, SCAN_LIMITS)
    assert sorted(read.columns) == ["ring", "x", "y", "z"]
    np.testing.assert_array_equal(read.columns["z"], np.arange(5) * 10)
    np.testing.assert_array_equal(read.columns["ring"], np.arange(5) + 3)


def test_points_counts_where_width_and_height_are_zero():
    assert len(decode_pcd(pcd(random_cloud(7), "binary", WIDTH=0, HEIGHT=0), SCAN_LIMITS)) == 7


def test_width_and_height_count_where_there_is_no_points_line():
    assert len(decode_pcd(pcd(random_cloud(6), "binary", WIDTH=3, HEIGHT=2, POINTS=None), SCAN_LIMITS)) == 6


def test_windows_line_ends_of_the_header():
    cloud = random_cloud(4)
    body = pcd_header(cloud, "ascii").replace(b"\n", b"\r\n") + pcd_body(cloud, "ascii").replace(
        b"\n", b"\r\n"
    )
    np.testing.assert_allclose(decode_pcd(body, SCAN_LIMITS).columns["x"], cloud["x"])


@every_case("encoding", ENCODINGS)
def test_an_empty_cloud_is_a_cloud_of_no_points(encoding):
    read = decode_pcd(pcd(random_cloud(0), encoding), SCAN_LIMITS)
    assert read.xyz.shape == (0, 3)


@every_case(
    ("replaced", "reason"),
    [
        ({"FIELDS": "x y q intensity ring"}, "no field z"),
        ({"SIZE": "4 4 4 4"}, "SIZE has 4 values"),
        ({"SIZE": "4 4 4 4 3"}, "unknown type"),
        ({"SIZE": "4 4 4 4 -2"}, "whole numbers"),
        ({"TYPE": "F F F F"}, "TYPE"),
        ({"TYPE": "F F F F X"}, "unknown type"),
        ({"COUNT": "1 1 1 1 0"}, "COUNT"),
        ({"COUNT": "1 1 1 1 999999999"}, "COUNT"),
        ({"WIDTH": 3}, "contradicts"),
        ({"POINTS": "9" * 5000}, "whole numbers"),
        ({"DATA": "binary_zipped"}, "is not ascii"),
        ({"FIELDS": None}, "FIELDS"),
        ({"POINTS": None, "WIDTH": None}, "neither POINTS nor WIDTH"),
    ],
)
def test_a_header_that_contradicts_itself_is_malformed(replaced, reason):
    with pytest.raises(MalformedData, match=reason):
        decode_pcd(pcd(random_cloud(5), "binary", **replaced), SCAN_LIMITS)


def test_no_bytes_and_no_header_are_malformed():
    with pytest.raises(MalformedData, match="empty"):
        decode_pcd(b"", SCAN_LIMITS)
    with pytest.raises(MalformedData, match="no PCD header: it is text"):
        decode_pcd(b"# comment\n" * 20_000, SCAN_LIMITS)


@every_case("encoding", ENCODINGS)
def test_a_promise_of_very_many_points_takes_no_memory(encoding):
    n = 10**12
    body = pcd_header(random_cloud(1), encoding, POINTS=n, WIDTH=n) + b"\0" * 100
    tracemalloc.start()
    with pytest.raises(TooLarge, match="1000000000000 points"):
        decode_pcd(body, SCAN_LIMITS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000


@every_case("encoding", ENCODINGS)
def test_points_within_the_limit_but_not_in_the_body_take_no_memory(encoding):
    n = 2_000_000
    body = (
        pcd_header(random_cloud(1), encoding, POINTS=n, WIDTH=n)
        + struct.pack("<II", 100, n * 18)
        + b"\0" * 100
    )
    tracemalloc.start()
    with pytest.raises(MalformedData):
        decode_pcd(body, SCAN_LIMITS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000


def test_the_limit_on_decoded_bytes():
    with pytest.raises(TooLarge, match="bytes"):
        decode_pcd(pcd(random_cloud(50), "binary"), Limits(max_points=100, max_decoded_bytes=500))


def test_compressed_sizes_that_lie():
    cloud = random_cloud(50)
    header, body = pcd_header(cloud, "binary_compressed"), pcd_body(cloud, "binary_compressed")
    packed, plain = struct.unpack("<II", body[:8])
    for sizes, reason in (
        ((packed, plain + 1), "claims"),
        ((packed + 1, plain), "cut off"),
        ((2**32 - 1, plain), "cut off"),
        ((3, plain), "cannot hold"),
        ((packed // 2, plain), "damaged"),
    ):
        with pytest.raises(MalformedData, match=reason):
            decode_pcd(header + struct.pack("<II", *sizes) + body[8:], SCAN_LIMITS)


@every_case("text", [b"1 2 x 4 5\n", b"1 2 3 4\n", b"1 2 3 4 5 6\n", b"1 2 3 4 \xff\xfe\n", b"1 2 3 4 \0\n"])
def test_ascii_rows_that_are_no_rows(text):
    with pytest.raises(MalformedData):
        decode_pcd(pcd_header(random_cloud(1), "ascii") + text, SCAN_LIMITS)


def test_one_endless_ascii_line_is_refused():
    with pytest.raises(MalformedData, match="a line of"):
        decode_pcd(pcd_header(random_cloud(1), "ascii") + b"1 " * 1_000_000, SCAN_LIMITS)
