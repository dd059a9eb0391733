from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.formats.raw_xyz import decode_xyz, decode_xyzi
from firstfix.formats.scanner_bin import decode_scanner_bin
from tests.every_case import every_case

ROWS = np.random.default_rng(3).uniform(-80, 80, (500, 4)).astype("<f4")


def test_rows_come_back():
    np.testing.assert_array_equal(decode_xyz(ROWS[:, :3].tobytes(), SCAN_LIMITS).xyz, ROWS[:, :3])
    read = decode_xyzi(ROWS.tobytes(), SCAN_LIMITS)
    np.testing.assert_array_equal(read.xyz, ROWS[:, :3])
    np.testing.assert_array_equal(read.intensity, ROWS[:, 3])


@every_case("decode", [decode_xyz, decode_xyzi])
def test_what_is_no_whole_number_of_rows_is_malformed(decode):
    for body in (b"", ROWS.tobytes()[:-1], b"abc"):
        with pytest.raises(MalformedData):
            decode(body, SCAN_LIMITS)


@every_case("decode", [decode_xyz, decode_xyzi])
def test_too_many_points(decode):
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
def test_bytes_that_are_no_scan_are_refused(size):
    noise = np.random.default_rng(7).bytes(size)
    with pytest.raises(UnsupportedFormat):
        decode_scanner_bin(noise, "a.bin", SCAN_LIMITS)
