from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.ply import decode_ply
from firstfix.formats.ply_header import parse_ply_header
from firstfix.formats.point_cloud import SCAN_LIMITS
from tests.core.formats.cloud_files import ply, random_cloud, text_rows
from tests.every_case import every_case

ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")


@every_case("encoding", ENCODINGS)
@every_case("dtype", ["f4", "f8"])
def test_every_column_comes_back(encoding, dtype):
    cloud = random_cloud(200, dtype)
    read = decode_ply(ply(cloud, encoding), SCAN_LIMITS)
    for name in cloud.dtype.names:
        np.testing.assert_array_equal(read.columns[name], cloud[name])
    np.testing.assert_array_equal(read.intensity, cloud["intensity"])


@every_case("encoding", ENCODINGS)
def test_double_coordinates_of_utm_size_are_exact(encoding):
    cloud = random_cloud(100, "f8")
    cloud["y"] += 5_403_210.123
    read = decode_ply(ply(cloud, encoding), SCAN_LIMITS)
    np.testing.assert_array_equal(read.xyz[:, 1], cloud["y"])


@every_case("encoding", ENCODINGS)
def test_elements_before_the_vertices_are_stepped_over(encoding):
    cloud = random_cloud(20)
    rows = {"ascii": b"1 2\n3 4\n", "binary_little_endian": struct.pack("<BdBd", 1, 2, 3, 4)}
    body = ply(
        cloud,
        encoding,
        before=b"element camera 2\nproperty uchar id\nproperty double f\n",
        before_body=rows.get(encoding, struct.pack(">BdBd", 1, 2, 3, 4)),
    )
    np.testing.assert_array_equal(decode_ply(body, SCAN_LIMITS).columns["x"], cloud["x"])


def test_ascii_lists_before_the_vertices_are_lines_like_others():
    before = b"element face 1\nproperty list uchar int vertex_indices\n"
    body = ply(random_cloud(5), "ascii", before=before, before_body=b"4 0 1 2 3\n")
    assert len(decode_ply(body, SCAN_LIMITS)) == 5


def test_binary_lists_before_the_vertices_are_unsupported():
    before = b"element face 1\nproperty list uchar int vertex_indices\n"
    body = ply(random_cloud(5), "binary_little_endian", before=before, before_body=b"\x01\0\0\0\0")
    with pytest.raises(UnsupportedFormat, match="before the vertices"):
        decode_ply(body, SCAN_LIMITS)


def test_windows_line_ends():
    cloud = random_cloud(5)
    body = ply(cloud, "ascii").replace(b"\n", b"\r\n")
    np.testing.assert_array_equal(decode_ply(body, SCAN_LIMITS).columns["z"], cloud["z"])


@every_case(
    ("old", "new", "reason"),
    [
        (b"ply\n", b"plx\n", "does not start"),
        (b"end_header", b"end_haeder", "cannot be read"),
        (b"property float x", b"property float q", "no field x"),
        (b"property float x", b"property half x", "cannot be read"),
        (b"property float x", b"property list uchar float x", "no field x"),
        (b"vertex 50", b"vertex -50", "not an element count"),
        (b"vertex 50", b"vertex " + b"9" * 5000, "not an element count"),
        (b"element vertex", b"element corner", "no element 'vertex'"),
        (b"format binary_little_endian 1.0\n", b"", "before its format"),
        (b"binary_little_endian", b"binary_middle_endian", "cannot be read"),
    ],
)
def test_a_header_that_cannot_be_read_is_malformed(old, new, reason):
    body = ply(random_cloud(50), "binary_little_endian").replace(old, new, 1)
    with pytest.raises(MalformedData, match=reason):
        decode_ply(body, SCAN_LIMITS)


def test_no_bytes_and_no_end_are_malformed():
    with pytest.raises(MalformedData, match="empty"):
        decode_ply(b"", SCAN_LIMITS)
    with pytest.raises(MalformedData, match="no end"):
        decode_ply(b"ply\nformat ascii 1.0\n" + b"comment x\n" * 20_000, SCAN_LIMITS)


def test_the_byte_order_must_be_known_before_the_numbers():
    body = b"ply\nelement vertex 0\nproperty float x\nformat binary_big_endian 1.0\nend_header\n"
    with pytest.raises(MalformedData, match="before its format"):
        parse_ply_header(body)


@every_case("encoding", ENCODINGS)
@every_case(("count", "error"), [(10**12, TooLarge), (1_900_000, MalformedData)])
def test_a_promise_of_very_many_vertices_takes_no_memory(encoding, count, error):
    body = ply(random_cloud(50), encoding).replace(b"vertex 50", b"vertex %d" % count)
    tracemalloc.start()
    with pytest.raises(error):
        decode_ply(body, SCAN_LIMITS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000


def test_the_faces_of_an_ascii_mesh_are_not_vertices():
    body = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    body += b"element face 2\nproperty list uchar int vertex_index\nend_header\n"
    body += text_rows(np.eye(3)) + b"3 0 1 2\n4 0 1 2 0\n"
    np.testing.assert_array_equal(decode_ply(body, SCAN_LIMITS).xyz, np.eye(3))
    assert parse_ply_header(body).count_of("face") == 2
