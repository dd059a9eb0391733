"""Times of points under the names and in the units of drivers and file formats."""

import io

import numpy as np
import pytest

from firstfix.decode import decode_query, read_scan_file
from firstfix.formats.point_cloud import point_times
from tests.core.formats.cloud_files import pcd, ply

N = 500
SWEEP_S = np.linspace(0, 0.1, N)
POINTS = np.random.default_rng(1).uniform(-20, 20, (N, 3)).astype(np.float32)
STAMP_S = 1_700_000_000.25


def columns(name: str, times: np.ndarray, **more: np.ndarray) -> dict[str, np.ndarray]:
    return {"x": POINTS[:, 0], "y": POINTS[:, 1], "z": POINTS[:, 2], name: times, **more}


@pytest.mark.parametrize(
    ("name", "times", "first_s"),
    [
        ("t", (SWEEP_S * 1e9).astype(np.uint32), 0.0),  # Ouster
        ("offset_time", (SWEEP_S * 1e9).astype(np.uint32), 0.0),  # Livox
        ("time", (SWEEP_S - 0.1).astype(np.float32), -0.1),  # Velodyne
        ("timestamp", STAMP_S - 0.05 + SWEEP_S, -0.05),  # Hesai, RoboSense
        ("timestamp", (STAMP_S + SWEEP_S) * 1e9, 0.0),  # Livox
        ("time_stamp", (SWEEP_S * 1e9).astype(np.uint32), 0.0),  # Autoware
        ("timestamp", STAMP_S + 40 + SWEEP_S, 0.0),  # another clock: from the first point
        ("time", (SWEEP_S + 1234.5), 0.0),  # since the sensor was switched on
        ("T", (SWEEP_S * 1e9), 0.0),  # an ascii file's numbers are all real
    ],
)
def test_times_of_drivers_are_read_in_their_units(name, times, first_s):
    found = point_times(columns(name, times), STAMP_S)
    assert found is not None
    assert found.time_s.dtype == np.float32
    np.testing.assert_allclose(found.time_s, first_s + SWEEP_S, atol=2e-6)
    assert found.stamp_s == STAMP_S


def test_without_a_stamp_the_first_point_since_the_epoch_is_it():
    found = point_times(columns("timestamp", STAMP_S + SWEEP_S[::-1]), None)
    assert found.stamp_s == STAMP_S
    np.testing.assert_allclose(found.time_s, SWEEP_S[::-1], atol=1e-6)
    assert point_times(columns("time", SWEEP_S), None).stamp_s is None


@pytest.mark.parametrize(
    "times",
    [
        np.zeros(N, np.uint32),
        np.full(N, STAMP_S),
        np.where(np.arange(N) == 7, np.nan, SWEEP_S),
        np.where(np.arange(N) == 7, np.inf, SWEEP_S),
        SWEEP_S * 1e12,
        (np.arange(N) * 10_000_000).astype(np.uint32),  # five seconds
        SWEEP_S.astype("S8"),
    ],
)
def test_invalid_times_are_left_out(times):
    assert point_times(columns("t", times), STAMP_S) is None


def test_places_in_a_picture_are_no_times():
    assert point_times(columns("t", SWEEP_S, s=SWEEP_S), None) is None
    assert point_times(columns("t", SWEEP_S), None) is not None


def test_times_of_invalid_points_do_not_matter():
    lost = np.arange(N) % 3 == 0
    x = np.where(lost, np.nan, POINTS[:, 0])
    found = point_times({**columns("time", np.where(lost, np.nan, SWEEP_S)), "x": x}, None)
    np.testing.assert_allclose(found.time_s[~lost], SWEEP_S[~lost], atol=1e-6)
    assert not found.time_s[lost].any()


def test_a_pcd_and_a_ply_have_times(tmp_path):
    record = np.zeros(N, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
    for axis, name in enumerate("xyz"):
        record[name] = POINTS[:, axis]
    record["t"] = SWEEP_S * 1e9
    bodies = (
        (pcd(record, "binary"), "application/x-pcd"),
        (ply(record, "binary_little_endian"), "application/ply"),
    )
    for body, media_type in bodies:
        scan = decode_query(body, media_type)
        np.testing.assert_allclose(scan.time_s, SWEEP_S, atol=1e-6)
    (tmp_path / "scan.pcd").write_bytes(bodies[0][0])
    assert read_scan_file(tmp_path / "scan.pcd").time_s is not None


def test_a_laz_scan_has_times(tmp_path):
    import laspy

    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 1e-3)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = POINTS.astype(np.float64).T
    cloud.gps_time = 432_000.5 + SWEEP_S  # seconds of the week
    buffer = io.BytesIO()
    cloud.write(buffer)
    (tmp_path / "scan.las").write_bytes(buffer.getvalue())
    scan = read_scan_file(tmp_path / "scan.las")
    np.testing.assert_allclose(scan.time_s, SWEEP_S, atol=1e-6)
    assert scan.stamp_s is None
