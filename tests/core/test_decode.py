from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest

from firstfix.decode import decode_query
from firstfix.errors import MalformedData, NotFound, TooLarge, UnsupportedFormat
from firstfix.scan.scan import MAX_POINTS, Scan
from firstfix.scan_file import READABLE, read_scan_file
from firstfix.scan_formats import LAS, MEDIA_TYPES, SUFFIXES
from firstfix.wire.content_encoding import undo_content_encoding
from tests.core.formats.cloud_files import pcd, ply, random_cloud
from tests.every_case import every_case
from tests.hostile_bodies import good_bodies

CLOUD = random_cloud(300)
XYZ = np.stack([CLOUD[axis] for axis in "xyz"], axis=1)


@every_case(
    ("media_type", "body", "has_intensity"),
    [
        ("application/x-pcd", pcd(CLOUD, "binary"), True),
        ("model/vnd.pcd", pcd(CLOUD, "binary_compressed"), True),
        ("Application/PLY; charset=binary", ply(CLOUD, "binary_big_endian"), True),
        ("model/ply", ply(CLOUD, "ascii"), True),
        ("application/vnd.firstfix.xyz", XYZ.tobytes(), False),
        ("application/vnd.firstfix.xyzi", np.c_[XYZ, CLOUD["intensity"]].tobytes(), True),
    ],
)
def test_a_body_is_read_by_its_media_type(media_type, body, has_intensity):
    scan = decode_query(body, media_type)
    np.testing.assert_array_equal(scan.points, XYZ)
    assert scan.points.dtype == np.float32
    assert (scan.intensity is not None) == has_intensity
    if has_intensity:
        np.testing.assert_array_equal(scan.intensity, CLOUD["intensity"])


def test_nan_returns_are_dropped():
    holed = CLOUD.copy()
    holed["z"][:7] = np.nan
    scan = decode_query(pcd(holed, "binary"), "application/x-pcd")
    np.testing.assert_array_equal(scan.points, XYZ[7:])
    np.testing.assert_array_equal(scan.intensity, CLOUD["intensity"][7:])


def test_unknown_media_types_and_too_many_points_are_refused():
    for media_type in ("image/png", "application/json", "x"):
        with pytest.raises(UnsupportedFormat, match="application/x-pcd"):
            decode_query(b"x", media_type)
    with pytest.raises(TooLarge):
        decode_query(bytes(12 * (MAX_POINTS + 1)), "application/vnd.firstfix.xyz")


def test_every_format_has_a_good_body_of_the_same_points_and_its_files_are_read(tmp_path: Path):
    bodies = {body.name: body for body in good_bodies()}
    assert {body.media_type for body in bodies.values()} == set(MEDIA_TYPES) - set(
        LAS
    )  # its process has tests of its own
    assert set(SUFFIXES) == set(READABLE)
    endings = {media_type: suffix for suffix, media_type in SUFFIXES.items()}
    points = np.frombuffer(bodies["xyz"].data, "<f4").reshape(-1, 3)
    for name, body in bodies.items():
        plain = undo_content_encoding(body.data, body.content_encoding or "", 1 << 20)
        scans = [decode_query(plain, body.media_type)]
        if body.media_type in endings:
            path = tmp_path / f"scan{endings[body.media_type]}"
            path.write_bytes(plain)
            scans.append(read_scan_file(path))
        for scan in scans:
            if isinstance(scan, Scan) and name != "range image":  # which leaves points out
                np.testing.assert_allclose(np.sort(scan.points, axis=0), np.sort(points, axis=0), atol=0.01)


def write_scan(path: Path) -> None:
    rows, suffix = np.c_[XYZ, CLOUD["intensity"]].astype("<f4"), path.suffix.lower()
    if suffix in (".pcd", ".ply", ".bin"):
        made = {
            ".pcd": pcd(CLOUD, "ascii"),
            ".ply": ply(CLOUD, "binary_little_endian"),
            ".bin": rows.tobytes(),
        }
        path.write_bytes(made[suffix])
    elif suffix == ".npy":
        np.save(path, rows)
    elif suffix in (".las", ".laz"):
        las = laspy.create(point_format=6, file_version="1.4")
        las.header.scales = [0.0001] * 3
        las.x, las.y, las.z = XYZ.T.astype(np.float64)
        las.intensity = CLOUD["intensity"].astype(np.uint16)
        las.write(path)
    else:
        np.savetxt(path, rows, fmt="%.6f", delimiter="," if suffix == ".csv" else " ")


@every_case(
    "name", ["a.pcd", "a.PLY", "a.bin", "a.npy", "a.xyz", "a.txt", "a.csv", "a.pts", "a.las", "a.laz"]
)
def test_a_file_is_read_by_its_ending(tmp_path: Path, name):
    write_scan(tmp_path / name)
    scan = read_scan_file(tmp_path / name)
    np.testing.assert_allclose(scan.points, XYZ, atol=1e-4)
    np.testing.assert_allclose(scan.intensity, CLOUD["intensity"], atol=1.0 if ".la" in name else 1e-4)


def test_an_error_names_its_file(tmp_path: Path):
    (tmp_path / "short.pcd").write_bytes(pcd(CLOUD, "binary")[:-100])
    (tmp_path / "empty.ply").write_bytes(b"")
    (tmp_path / "a.las").write_bytes(b"LASF" + bytes(300))
    (tmp_path / "photo.png").write_bytes(b"x")
    for name, error in (
        ("short.pcd", MalformedData),
        ("empty.ply", MalformedData),
        ("a.las", MalformedData),
        ("photo.png", UnsupportedFormat),
        ("absent.pcd", NotFound),
    ):
        with pytest.raises(error, match=name):
            read_scan_file(tmp_path / name)


def test_a_file_that_is_not_there_is_also_pythons_own_error(tmp_path: Path):
    for name in ("absent.pcd", "absent.las", "absent.ffscan"):
        with pytest.raises(FileNotFoundError, match=name) as caught:
            read_scan_file(tmp_path / name)
        assert isinstance(caught.value, NotFound)
        assert str(tmp_path) in str(caught.value)


def test_a_cut_off_laz_is_malformed(tmp_path: Path):
    las = laspy.create(point_format=0)
    las.x, las.y, las.z = np.random.default_rng(0).uniform(0, 100, (3, 20_000))
    las.write(tmp_path / "a.laz")
    raw = (tmp_path / "a.laz").read_bytes()
    for share in (0.002, 0.1, 0.5, 0.9, 0.99):
        (tmp_path / "a.laz").write_bytes(raw[: int(len(raw) * share)])
        with pytest.raises(MalformedData, match=r"a\.laz"):
            read_scan_file(tmp_path / "a.laz")


def test_importing_the_decoders_imports_no_optional_package():
    code = "import sys, firstfix.decode; print(sorted({'lzf', 'laspy', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
