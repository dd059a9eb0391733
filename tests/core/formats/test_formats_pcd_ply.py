"""PCD and PLY: every encoding is read, and headers that promise too much are refused in little memory."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.pcd import decode_pcd
from firstfix.formats.ply import decode_ply
from firstfix.formats.ply_header import parse_ply_header
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from tests.core.fixtures import in_memory_of
from tests.core.formats.cloud_files import pcd, pcd_body, pcd_header, ply, random_cloud, text_rows
from tests.every_case import every_case

ENCODINGS = ("ascii", "binary", "binary_compressed")
PLY_ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
FORMATS = [(decode_pcd, pcd, encoding) for encoding in ENCODINGS]
FORMATS += [(decode_ply, ply, encoding) for encoding in PLY_ENCODINGS]
each_format = every_case(("decode", "make", "encoding"), FORMATS)


@each_format
@every_case("dtype", ["f4", "f8"])
def test_every_column_comes_back(decode, make, encoding, dtype):
    cloud = random_cloud(200, dtype)
    read = decode(make(cloud, encoding), SCAN_LIMITS)
    assert list(read.columns) == ["x", "y", "z", "intensity", "ring"]
    for name in cloud.dtype.names:
        np.testing.assert_array_equal(read.columns[name], cloud[name])
    np.testing.assert_array_equal(read.intensity, cloud["intensity"])


@each_format
def test_double_coordinates_of_utm_size_are_exact(decode, make, encoding):
    cloud = random_cloud(100, "f8")
    cloud["x"] += 512_345.678
    cloud["y"] += 5_403_210.123
    read = decode(make(cloud, encoding), SCAN_LIMITS)
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
def test_every_number_type_is_read(kind, encoding):
    cloud = np.zeros(3, [("x", "<f4"), ("extra", "<" + kind), ("y", "<f4"), ("z", "<f8")])
    cloud["extra"], cloud["z"] = [1, 2, 100], [7, 8, 9]
    read = decode_pcd(pcd(cloud, encoding), SCAN_LIMITS)
    np.testing.assert_array_equal(read.columns["extra"], [1, 2, 100])
    np.testing.assert_array_equal(read.columns["z"], [7, 8, 9])


@every_case("encoding", ["binary", "binary_compressed", "ascii"])
def test_padding_and_fields_of_several_numbers_are_stepped_over(encoding):
    fields = "<f4,<f4,4u1,<f4,3<f4,<u2"
    cloud = np.zeros(5, fields)
    cloud.dtype.names = ("x", "y", "_", "z", "histogram", "ring")
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


@every_case(("decode", "make"), [(decode_pcd, pcd), (decode_ply, ply)])
def test_windows_line_ends_are_read(decode, make):
    cloud = random_cloud(5)
    body = make(cloud, "ascii").replace(b"\n", b"\r\n")
    np.testing.assert_array_equal(decode(body, SCAN_LIMITS).columns["z"], cloud["z"])


@every_case("encoding", ENCODINGS)
def test_an_empty_cloud_is_a_cloud_of_no_points(encoding):
    assert decode_pcd(pcd(random_cloud(0), encoding), SCAN_LIMITS).xyz.shape == (0, 3)


@every_case("counts", [{"WIDTH": 0, "HEIGHT": 0}, {"WIDTH": 3, "HEIGHT": 2, "POINTS": None}])
def test_points_or_width_and_height_count(counts):
    assert len(decode_pcd(pcd(random_cloud(6), "binary", **counts), SCAN_LIMITS)) == 6


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
def test_an_invalid_pcd_header_is_malformed(replaced, reason):
    with pytest.raises(MalformedData, match=reason):
        decode_pcd(pcd(random_cloud(5), "binary", **replaced), SCAN_LIMITS)


def test_a_missing_header_is_malformed():
    with pytest.raises(MalformedData, match="empty"):
        decode_pcd(b"", SCAN_LIMITS)
    with pytest.raises(MalformedData, match="no PCD header: it is text"):
        decode_pcd(b"# comment\n" * 20_000, SCAN_LIMITS)


def promising(make, encoding: str, n: int) -> bytes:
    """A body whose header promises n points."""
    if make is ply:
        return ply(random_cloud(50), encoding).replace(b"vertex 50", b"vertex %d" % n)
    sizes = struct.pack("<II", 100, min(n * 18, 2**32 - 1))
    return pcd_header(random_cloud(1), encoding, POINTS=n, WIDTH=n) + sizes + b"\0" * 100


@each_format
@every_case(("count", "error"), [(10**12, TooLarge), (1_900_000, MalformedData)])
def test_a_promise_of_very_many_points_takes_no_memory(decode, make, encoding, count, error):
    with in_memory_of(1_000_000), pytest.raises(error):
        decode(promising(make, encoding, count), SCAN_LIMITS)


def test_decoded_bytes_are_limited():
    with pytest.raises(TooLarge, match="bytes"):
        decode_pcd(pcd(random_cloud(50), "binary"), Limits(max_points=100, max_decoded_bytes=500))


def test_contradictory_compressed_sizes_are_malformed():
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
def test_invalid_ascii_rows_are_malformed(text):
    with pytest.raises(MalformedData):
        decode_pcd(pcd_header(random_cloud(1), "ascii") + text, SCAN_LIMITS)


def test_one_endless_ascii_line_is_refused():
    with pytest.raises(MalformedData, match="a line of"):
        decode_pcd(pcd_header(random_cloud(1), "ascii") + b"1 " * 1_000_000, SCAN_LIMITS)


@every_case("encoding", PLY_ENCODINGS)
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


def test_ascii_lists_before_the_vertices_are_skipped():
    before = b"element face 1\nproperty list uchar int vertex_indices\n"
    body = ply(random_cloud(5), "ascii", before=before, before_body=b"4 0 1 2 3\n")
    assert len(decode_ply(body, SCAN_LIMITS)) == 5


def test_binary_lists_before_the_vertices_are_unsupported():
    before = b"element face 1\nproperty list uchar int vertex_indices\n"
    body = ply(random_cloud(5), "binary_little_endian", before=before, before_body=b"\x01\0\0\0\0")
    with pytest.raises(UnsupportedFormat, match="before the vertices"):
        decode_ply(body, SCAN_LIMITS)


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
def test_an_invalid_ply_header_is_malformed(old, new, reason):
    body = ply(random_cloud(50), "binary_little_endian").replace(old, new, 1)
    with pytest.raises(MalformedData, match=reason):
        decode_ply(body, SCAN_LIMITS)


def test_an_endless_ply_header_is_malformed():
    with pytest.raises(MalformedData, match="empty"):
        decode_ply(b"", SCAN_LIMITS)
    with pytest.raises(MalformedData, match="no end"):
        decode_ply(b"ply\nformat ascii 1.0\n" + b"comment x\n" * 20_000, SCAN_LIMITS)


def test_the_byte_order_must_be_known_before_the_numbers():
    body = b"ply\nelement vertex 0\nproperty float x\nformat binary_big_endian 1.0\nend_header\n"
    with pytest.raises(MalformedData, match="before its format"):
        parse_ply_header(body)


def test_the_faces_of_an_ascii_mesh_are_not_vertices():
    body = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    body += b"element face 2\nproperty list uchar int vertex_index\nend_header\n"
    body += text_rows(np.eye(3)) + b"3 0 1 2\n4 0 1 2 0\n"
    np.testing.assert_array_equal(decode_ply(body, SCAN_LIMITS).xyz, np.eye(3))
    assert parse_ply_header(body).count_of("face") == 2


@every_case("encoding", ["binary", "binary_compressed"])
@every_case("points", [1, 500])
def test_a_pcd_that_went_through_a_text_mode_transfer_is_mended(points, encoding):
    cloud = random_cloud(points)
    cloud["ring"][:1] = 0x0D0A  # CR LF, the other way round: as it is in the file
    whole = pcd(cloud, encoding)
    read = decode_pcd(whole.replace(b"\n", b"\r\n"), SCAN_LIMITS)
    for name in cloud.dtype.names:
        np.testing.assert_array_equal(read.columns[name], cloud[name])
    head = pcd_header(cloud, encoding)  # written on Windows: the header alone has CR LF
    read = decode_pcd(head.replace(b"\n", b"\r\n") + pcd_body(cloud, encoding), SCAN_LIMITS)
    np.testing.assert_array_equal(read.columns["z"], cloud["z"])


def test_a_ply_that_went_through_a_text_mode_transfer_is_mended():
    cloud = random_cloud(500)
    whole = ply(cloud, "binary_little_endian").replace(b"\n", b"\r\n")
    read = decode_ply(whole, SCAN_LIMITS)
    for name in cloud.dtype.names:
        np.testing.assert_array_equal(read.columns[name], cloud[name])
    no_faces = ply(cloud, "binary_little_endian").replace(b"element face 1", b"element face 0")
    plain = no_faces.replace(b"element face 0\nproperty list uchar int vertex_indices\n", b"")[:-13]
    read = decode_ply(plain.replace(b"\n", b"\r\n"), SCAN_LIMITS)
    np.testing.assert_array_equal(read.columns["ring"], cloud["ring"])
    with pytest.raises(MalformedData, match="damaged by a text-mode transfer"):
        decode_ply(plain.replace(b"\n", b"\r\n")[:-30], SCAN_LIMITS)


@every_case("encoding", ["binary", "binary_compressed"])
def test_a_pcd_that_a_transfer_damaged_and_cut_is_named(encoding):
    whole = pcd(random_cloud(5000), encoding).replace(b"\n", b"\r\n")
    with pytest.raises(MalformedData, match=r"damaged by a text-mode transfer, .*: copy it again as binary"):
        decode_pcd(whole[:-50], SCAN_LIMITS)


@every_case("decode, make", [(decode_pcd, pcd), (decode_ply, ply)])
def test_axes_in_capitals_are_taken_and_missing_ones_named_with_the_fields(decode, make):
    encoding = "binary" if make is pcd else "binary_little_endian"
    capitals, other = random_cloud(5), random_cloud(5)
    capitals.dtype.names = ("X", "Y", "Z", "intensity", "ring")
    np.testing.assert_array_equal(decode(make(capitals, encoding), SCAN_LIMITS).xyz[:, 2], capitals["Z"])
    other.dtype.names = ("range", "azimuth", "z", "intensity", "ring")
    with pytest.raises(MalformedData, match="no field x, y; its fields: range, azimuth, z, intensity, ring"):
        decode(make(other, encoding), SCAN_LIMITS)
