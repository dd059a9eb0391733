from __future__ import annotations

import contextlib
import struct
from pathlib import Path

import laspy
import numpy as np
import pye57
import pytest

from firstfix.errors import InputError, InvalidOption, MalformedData, NotFound, UnsupportedFormat
from firstfix.transform import from_quaternion, inverse, transform_points
from firstfix_builder.sources.read_map import read_map

UTM = np.array([512_345.678, 5_403_210.123, 295.5])
POINTS = np.random.default_rng(11).uniform([-60, -40, 0], [60, 40, 8], (400, 3))


def write_pcd(path: Path, points: np.ndarray, kind: str = "<f8", fields: str = "x y z") -> Path:
    """(n, k) numbers, k named fields."""
    count = len(fields.split())
    header = (
        f"VERSION 0.7\nFIELDS {fields}\nSIZE {f'{kind[-1]} ' * count}\nTYPE {'F ' * count}\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA binary\n"
    )
    path.write_bytes(header.encode() + np.asarray(points, kind).tobytes())
    return path


def write_ply(path: Path, points: np.ndarray, kind: str = "double") -> Path:
    header = f"ply\nformat binary_big_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property {kind} {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(header.encode() + np.asarray(points, ">f8" if kind == "double" else ">f4").tobytes())
    return path


def write_las(path: Path, points: np.ndarray) -> Path:
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.scales, las.header.offsets = [0.0001] * 3, points[0]
    las.x, las.y, las.z = points.T
    las.write(path)
    return path


def write_e57(path: Path, points: np.ndarray) -> Path:
    """Two scans, each half of the points in the frame of its own pose."""
    poses = [
        from_quaternion(points[0], [0.1, 0.2, 0.3, 0.9]),
        from_quaternion(points[1], [0.0, 0.0, 1.0, 0.0]),
    ]
    file = pye57.E57(str(path), mode="w")
    for T, part in zip(poses, np.array_split(points, 2), strict=True):
        local = transform_points(inverse(T), part)
        quaternion = [0.9, 0.1, 0.2, 0.3] if T is poses[0] else [0.0, 0.0, 0.0, 1.0]  # w first
        file.write_scan_raw(
            {f"cartesian{axis}": np.ascontiguousarray(local[:, i]) for i, axis in enumerate("XYZ")},
            rotation=np.array(quaternion) / np.linalg.norm(quaternion),
            translation=T[:3, 3],
        )
    file.close()
    return path


def write_text(path: Path, points: np.ndarray) -> Path:
    np.savetxt(path, points, fmt="%.6f", delimiter="," if path.suffix == ".csv" else " ")
    return path


def write_npy(path: Path, points: np.ndarray) -> Path:
    np.save(path, points)
    return path


WRITERS = {
    "map.pcd": write_pcd,
    "map.ply": write_ply,
    "map.las": write_las,
    "map.laz": write_las,
    "map.e57": write_e57,
    "map.xyz": write_text,
    "map.csv": write_text,
    "map.txt": write_text,
    "map.pts": write_text,
    "map.npy": write_npy,
}


@pytest.mark.parametrize("name", WRITERS)
def test_utm_coordinates_keep_their_millimetres(tmp_path, name):
    data = read_map(WRITERS[name](tmp_path / name, POINTS + UTM))
    np.testing.assert_array_equal(data.origin, [512_300, 5_403_200, 0])
    np.testing.assert_allclose(data.points + data.origin, POINTS + UTM, rtol=0, atol=0.001)
    # what a float32 of the local coordinate still has: the reason for the local origin
    np.testing.assert_allclose(data.points.astype(np.float32) + data.origin, POINTS + UTM, rtol=0, atol=0.001)


@pytest.mark.parametrize("name", WRITERS)
def test_small_coordinates_stay_as_they_are(tmp_path, name):
    data = read_map(WRITERS[name](tmp_path / name, POINTS))
    np.testing.assert_array_equal(data.origin, np.zeros(3))
    np.testing.assert_allclose(data.points, POINTS, atol=1e-4)
    assert data.vertices is None
    assert data.triangles is None


@pytest.mark.parametrize("name", WRITERS)
def test_empty_cut_off_and_senseless_files_name_the_file(tmp_path, name):
    path = WRITERS[name](tmp_path / name, POINTS)
    whole = path.read_bytes()
    contents = [b"", b"\0" * 5000, b"no such format\n" * 100, np.random.default_rng(0).bytes(4096)]
    if path.suffix not in (".xyz", ".csv", ".txt", ".pts"):  # cut text is a shorter text
        contents += [whole[: int(len(whole) * share)] for share in (0.01, 0.1, 0.5, 0.9, 0.99)]
    for content in contents:
        path.write_bytes(content)
        with pytest.raises(MalformedData) as caught:
            read_map(path)
        assert str(caught.value).startswith(f"{name}: ")
        assert len(str(caught.value)) > len(name) + 10
        assert str(tmp_path) not in str(caught.value)


def test_e57_poses_are_the_trajectory(tmp_path):
    data = read_map(write_e57(tmp_path / "a.e57", POINTS + UTM))
    assert data.trajectory.shape == (2, 4, 4)
    np.testing.assert_allclose(data.trajectory[:, :3, 3] + data.origin, POINTS[:2] + UTM, atol=1e-6)


def test_not_finite_points_are_dropped(tmp_path):
    points = POINTS.copy()
    points[:5] = np.nan
    points[5, 2], points[6, 0], points[7, 1] = np.inf, -np.inf, 1e30
    data = read_map(write_pcd(tmp_path / "a.pcd", points))
    np.testing.assert_array_equal(data.points, POINTS[8:])
    with pytest.raises(MalformedData, match=r"a\.pcd: none of its 3 points"):
        read_map(write_pcd(tmp_path / "a.pcd", np.full((3, 3), np.nan)))
    with pytest.raises(MalformedData, match=r"a\.pcd: none of its 0 points"):
        read_map(write_pcd(tmp_path / "a.pcd", np.empty((0, 3))))


def test_a_stray_point_does_not_choose_the_origin(tmp_path):
    points = POINTS.copy()
    points[0] = [3e7, 3e7, 0]
    np.testing.assert_array_equal(read_map(write_pcd(tmp_path / "a.pcd", points)).origin, np.zeros(3))


def test_the_axis_option_turns_points_and_poses(tmp_path):
    cloud = write_pcd(tmp_path / "a.pcd", [[1, 2, 3]])  # left 1, up 2, forward 3
    poses = tmp_path / "t.txt"
    poses.write_text("0 1 2 3 0 0.7071068 0 0.7071068\n")  # a quarter turn to the left about up
    data = read_map(cloud, axis="y-up", trajectory=poses)
    np.testing.assert_array_equal(data.points, [[3, 1, 2]])
    np.testing.assert_allclose(data.trajectory[0, :3, 3], [3, 1, 2])
    np.testing.assert_allclose(data.trajectory[0, :3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    with pytest.raises(InvalidOption):
        read_map(cloud, axis="x-up")  # type: ignore[arg-type]


def test_a_given_trajectory_moves_with_the_map(tmp_path):
    cloud = write_las(tmp_path / "a.laz", POINTS + UTM)
    poses = tmp_path / "t.txt"
    poses.write_text(" ".join(f"{v:.6f}" for v in (0, *UTM, 0, 0, 0, 1)))
    data = read_map(cloud, trajectory=poses)
    np.testing.assert_allclose(data.trajectory[0, :3, 3], UTM - data.origin, atol=1e-6)


def test_a_kitti_scan_is_read(tmp_path):
    rows = np.c_[POINTS, np.ones(len(POINTS))].astype("<f4")
    (tmp_path / "000000.bin").write_bytes(rows.tobytes())
    np.testing.assert_array_equal(read_map(tmp_path / "000000.bin").points, rows[:, :3])


def test_3dtk_centimetres_turned_to_rep_103(tmp_path):
    (tmp_path / "scan000.3d").write_text("100 200 300\n0 0 50\n")  # right, up, forward
    np.testing.assert_allclose(read_map(tmp_path / "scan000.3d").points, [[3, -1, 2], [0.5, 0, 0]])


def test_missing_files_and_files_without_a_reader_are_named(tmp_path):
    (tmp_path / "a.docx").write_bytes(b"x")
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "velodyne.bin").write_bytes(struct.pack("<7I", *range(7)))
    for name, error in (
        ("a.docx", UnsupportedFormat),
        ("a.bag", UnsupportedFormat),
        ("velodyne.bin", UnsupportedFormat),
        ("absent.pcd", NotFound),
    ):
        with pytest.raises(error, match=f"^{name}: "):
            read_map(tmp_path / name)


@pytest.mark.parametrize("name", ["map.las", "map.laz", "map.e57"])
def test_damaged_bytes_in_library_formats_give_only_input_errors(tmp_path, name):
    path = WRITERS[name](tmp_path / name, POINTS)
    whole, random = path.read_bytes(), np.random.default_rng(2)
    for place in np.r_[0:100, random.integers(100, len(whole), 40)]:
        damaged = bytearray(whole)
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        with contextlib.suppress(InputError):
            assert read_map(path).points is not None
