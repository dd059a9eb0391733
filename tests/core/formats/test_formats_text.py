"""Points as text, NumPy arrays, rows of floats and records of scanners."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.npy import decode_npy, read_npy
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.formats.raw_xyz import decode_xyz, decode_xyzi
from firstfix.formats.scanner_bin import decode_scanner_bin
from firstfix.formats.text import decode_text
from firstfix.scan_file import scan_of_cloud
from tests.every_case import every_case

XYZ = np.array([[1.5, 2.0, -3.25], [512_345.678, 5_403_210.123, 295.5]])


@every_case(
    "text",
    [
        b"1.5 2 -3.25\n512345.678 5403210.123 295.5\n",
        b"1.5 2 -3.25\n\n  512345.678\t5403210.123   295.5",
        b"1.5,2,-3.25\r\n512345.678,5403210.123,295.5\r\n",
        b"1.5; 2; -3.25\n512345.678; 5403210.123; 295.5\n",
        b"2\n1.5 2 -3.25 7 0 0 0\n512345.678 5403210.123 295.5 8 0 0 0\n",
        b"# a comment\n1.5 2 -3.25 9 9\n# another\n512345.678 5403210.123 295.5 9 9\n",
        b"x,y,z\n1.5,2,-3.25\n512345.678,5403210.123,295.5\n",
        b"\xef\xbb\xbflabel,Z,X,Y\ntree,-3.25,1.5,2\ncar,295.5,512345.678,5403210.123\n".replace(
            b"tree", b"1"
        ),
        b'"X" "Y" "Z" "I"\n1.5 2 -3.25 0\n512345.678 5403210.123 295.5 0\n',
        b"//Z X Y R G B\n2\n-3.25 1.5 2 1 2 3\n295.5 512345.678 5403210.123 1 2 3\n",
    ],
)
def test_points_are_read_in_every_way_of_writing(text):
    text = text.replace(b"\ncar,", b"\n2,")
    np.testing.assert_array_equal(decode_text(text, SCAN_LIMITS).xyz, XYZ)


def test_intensity_is_known_by_name_and_by_place():
    np.testing.assert_array_equal(decode_text(b"i,x,y,z,intensity\n1,2,3,4,5\n", SCAN_LIMITS).intensity, [5])
    np.testing.assert_array_equal(decode_text(b"1 2 3 4\n5 6 7 8\n", SCAN_LIMITS).intensity, [4, 8])
    assert decode_text(b"1 2 3\n", SCAN_LIMITS).intensity is None


@every_case(
    ("text", "reason"),
    [
        (b"", "empty"),
        (b"\n\n", "no row"),
        (b"# only\n# comments\n", "no row"),
        (b"1 2\n3 4\n", "rows of 2 numbers"),
        (b"1 2 3 4 5 6 7 8 9 10 11 12\n", "rows of 12 numbers"),
        (b"a,b,c\n1,2,3\n", "no field x, y, z"),
        (b"x,y,z\nq,2,3\n", "not a row of numbers"),
        (b"1 2 3\n4 5\n", "."),
        (b"1 2 3\n4 5 six\n", "."),
        (b"1 2 3\n4 5 \0\n", "not text"),
        (b"3\n1 2 3\n4 5 6\n", "cut off: 2 of 3 points"),
        (b"3\n4\n1 2 3\n", "single number"),
        (b"1 2 3\n" + b"1 " * 100_000, "a line of"),
    ],
)
def test_an_invalid_table_is_malformed(text, reason):
    with pytest.raises(MalformedData, match=reason):
        decode_text(text, SCAN_LIMITS)


@every_case("text", [b"1 2 3\n" * 20, b"1 2 3\n" * 19 + b"1 2 3"])
def test_too_many_rows_of_text_are_refused(text):
    with pytest.raises(TooLarge):
        decode_text(text, Limits(max_points=19, max_decoded_bytes=10**9))


def test_npy_arrays_are_read(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.hstack([XYZ, [[7], [8]]]))
    read = read_npy(path, SCAN_LIMITS)
    np.testing.assert_array_equal(read.xyz, XYZ)
    np.testing.assert_array_equal(read.intensity, [7, 8])
    np.save(path, np.array([(1, 2, 3)], [("z", "f4"), ("x", "f4"), ("y", "i4")]))
    np.testing.assert_array_equal(read_npy(path, SCAN_LIMITS).xyz, [[2, 3, 1]])


@pytest.mark.parametrize(
    "array",
    [np.zeros(3), np.zeros((5, 2)), np.zeros((2, 3, 3)), np.array([["a", "b", "c"]])]
    + [np.zeros((3, 3), complex), np.array([{"a": 1}], object)],
)
def test_npy_files_of_other_arrays_are_malformed(tmp_path, array):
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(MalformedData):
        read_npy(tmp_path / "a.npy", SCAN_LIMITS)


def test_damaged_and_pickled_npy_files_are_malformed(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((100, 3)))
    raw = path.read_bytes()
    for damaged in (
        *(raw[:500], raw[:5], b"", b"\x93NUMPY" + bytes(100)),
        raw.replace(b"(100, 3)", b"(10**9,3"),
        raw.replace(b"(100, 3), }         ", b"(9999999999999, 3), "),
    ):
        path.write_bytes(damaged)
        with pytest.raises(MalformedData):
            read_npy(path, SCAN_LIMITS)


ROWS = np.random.default_rng(3).uniform(-80, 80, (500, 4)).astype("<f4")


@every_case("rows", [b"-1", b"-20"])
def test_an_npy_file_of_a_negative_length_is_malformed(rows):
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (" + rows + b", 3), }\n"
    with pytest.raises(MalformedData, match="header is damaged"):
        decode_npy(b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header + bytes(240), SCAN_LIMITS)


def test_rows_of_floats_come_back():
    np.testing.assert_array_equal(decode_xyz(ROWS[:, :3].tobytes(), SCAN_LIMITS).xyz, ROWS[:, :3])
    read = decode_xyzi(ROWS.tobytes(), SCAN_LIMITS)
    np.testing.assert_array_equal(read.xyz, ROWS[:, :3])
    np.testing.assert_array_equal(read.intensity, ROWS[:, 3])


@every_case("decode", [decode_xyz, decode_xyzi])
def test_a_part_of_a_row_is_malformed(decode):
    for body in (b"", ROWS.tobytes()[:-1], b"abc"):
        with pytest.raises(MalformedData):
            decode(body, SCAN_LIMITS)


@every_case("decode", [decode_xyz, decode_xyzi])
def test_too_many_rows_of_floats_are_refused(decode):
    with pytest.raises(TooLarge):
        decode(bytes(48 * 100), Limits(max_points=99, max_decoded_bytes=10**9))


def test_a_kitti_file_is_xyzi():
    np.testing.assert_array_equal(
        decode_scanner_bin(ROWS.tobytes(), "000094.bin", SCAN_LIMITS).xyz, ROWS[:, :3]
    )


def test_nclt_records_are_turned_to_z_up():
    record = np.array([(20_200, 19_800, 20_100, 9, 5)], "<u2,<u2,<u2,u1,u1")  # x 1 m, y -1 m, z 0.5 m (down)
    read = decode_scanner_bin(record.tobytes(), "123.velodyne_sync.bin", SCAN_LIMITS)
    np.testing.assert_allclose(read.xyz, [[1.0, 1.0, -0.5]], atol=1e-9)
    with pytest.raises(MalformedData, match="cut off"):
        decode_scanner_bin(record.tobytes()[:-1], "123.velodyne_sync.bin", SCAN_LIMITS)


def test_avia_records_are_known_by_their_size():
    record = np.dtype("<f4,<f4,<f4,u1,u1,u1,<u4")
    records = np.zeros(77, record)
    for column, field in enumerate(("f0", "f1", "f2")):
        records[field] = ROWS[:77, column]
    read = decode_scanner_bin(records.tobytes(), "a.bin", SCAN_LIMITS)
    np.testing.assert_array_equal(read.xyz, ROWS[:77, :3])


@every_case("size", [16 * 1000, 19 * 1000, 12_345])
def test_bin_files_of_noise_are_refused(size):
    noise = np.random.default_rng(7).bytes(size)
    with pytest.raises(UnsupportedFormat):
        decode_scanner_bin(noise, "a.bin", SCAN_LIMITS)


OUSTER = (
    "# Frame number: 1066\n# TIMESTAMP (ns), ROW, DESTAGGERED IMAGE COLUMN, MEASUREMENT_ID, FLAGS, "
    "NEAR_IR (photons), RANGE (mm), REFLECTIVITY (%), X1 (m), Y1 (m), Z1 (m)\n"
)


def test_the_csv_of_ouster_cli_is_read():
    """Its names stand in the second comment; a row without a return is at the origin (ouster-sdk 1.0.1)."""
    n = 300
    ns = 1_730_000_000_000_000_000 + np.linspace(0, 99_900_000, n).astype(np.int64)
    xyz = np.random.default_rng(0).uniform(-20, 20, (n, 3)).round(4)
    xyz[::3] = 0
    rows = [
        f"{t}, {k % 128}, {k // 128}, {k // 128}, 1, 200, {round(1000 * float(np.linalg.norm(p)))}, 12, "
        f"{p[0]:.4f}, {p[1]:.4f}, {p[2]:.4f}"
        for k, (t, p) in enumerate(zip(ns, xyz, strict=True))
    ]
    cloud = decode_text((OUSTER + "\n".join(rows) + "\n").encode(), SCAN_LIMITS)
    np.testing.assert_array_equal(cloud.xyz, xyz)
    np.testing.assert_array_equal(cloud.ring, np.arange(n) % 128)
    assert (cloud.intensity == 12).all()
    found = scan_of_cloud(cloud)
    back = (xyz != 0).any(axis=1)
    assert found.stamp_s == pytest.approx(ns[0] / 1e9, abs=1e-6)
    np.testing.assert_allclose(found.time_s[back], ((ns - ns[0]) / 1e9)[back], atol=1e-6)


def test_times_and_beams_of_named_columns_are_read():
    rows = "x y z ring t\n" + "".join(f"{k} 1 2 {k % 4} {k * 100_000}\n" for k in range(1000))
    cloud = decode_text(rows.encode(), SCAN_LIMITS)
    np.testing.assert_array_equal(cloud.ring, np.arange(1000) % 4)
    np.testing.assert_allclose(scan_of_cloud(cloud).time_s, np.arange(1000) * 1e-4, atol=1e-6)


def test_names_that_are_not_understood_are_shown():
    with pytest.raises(MalformedData, match="names x, y, z, and not '# range, azimuth"):
        decode_text(b"# range, azimuth\n" + b"1," * 11 + b"2\n", SCAN_LIMITS)


@pytest.mark.timeout(60)  # not a measurement: what it guards against takes days
@every_case("name", [b"a" + b" " * 60_000 + b"b", b"(" * 60_000, b"a (" * 20_000])
def test_a_long_name_of_a_column_takes_no_time(name):
    for mark in (b"# ", b""):
        text = mark + b"x (m),y(m), z  (m)," + name + b"\n1.5,2,-3.25,0\n512345.678,5403210.123,295.5,0\n"
        np.testing.assert_array_equal(decode_text(text, SCAN_LIMITS).xyz, XYZ)
