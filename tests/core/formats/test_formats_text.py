from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge
from firstfix.formats.npy import read_npy
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.formats.text import decode_text
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
def test_the_ways_to_write_points(text):
    text = text.replace(b"\ncar,", b"\n2,")
    np.testing.assert_array_equal(decode_text(text, SCAN_LIMITS).xyz, XYZ)


def test_intensity_by_name_and_by_place():
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
def test_what_is_no_table_of_points_is_malformed(text, reason):
    with pytest.raises(MalformedData, match=reason):
        decode_text(text, SCAN_LIMITS)


def test_too_many_rows():
    with pytest.raises(TooLarge):
        decode_text(b"1 2 3\n" * 20, Limits(max_points=19, max_decoded_bytes=10**9))
    with pytest.raises(TooLarge):
        decode_text(b"1 2 3\n" * 19 + b"1 2 3", Limits(max_points=19, max_decoded_bytes=10**9))


def test_npy(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.hstack([XYZ, [[7], [8]]]))
    read = read_npy(path, SCAN_LIMITS)
    np.testing.assert_array_equal(read.xyz, XYZ)
    np.testing.assert_array_equal(read.intensity, [7, 8])
    np.save(path, np.array([(1, 2, 3)], [("z", "f4"), ("x", "f4"), ("y", "i4")]))
    np.testing.assert_array_equal(read_npy(path, SCAN_LIMITS).xyz, [[2, 3, 1]])


@pytest.mark.parametrize(
    "array",
    [
        np.zeros(3),
        np.zeros((5, 2)),
        np.zeros((2, 3, 3)),
        np.array([["a", "b", "c"]]),
        np.zeros((3, 3), complex),
    ],
)
def test_npy_that_is_no_cloud(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(MalformedData):
        read_npy(tmp_path / "a.npy", SCAN_LIMITS)


def test_npy_damaged_pickled_or_lying(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.array([{"a": 1}], object), allow_pickle=True)
    with pytest.raises(MalformedData):
        read_npy(path, SCAN_LIMITS)
    np.save(path, np.zeros((100, 3)))
    raw = path.read_bytes()
    for damaged in (
        raw[:500],
        raw[:5],
        b"",
        b"\x93NUMPY" + bytes(100),
        raw.replace(b"(100, 3)", b"(10**9,3"),
    ):
        path.write_bytes(damaged)
        with pytest.raises(MalformedData):
            read_npy(path, SCAN_LIMITS)
    path.write_bytes(raw.replace(b"(100, 3), }         ", b"(9999999999999, 3), "))
    with pytest.raises(MalformedData):
        read_npy(path, SCAN_LIMITS)
