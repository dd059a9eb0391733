from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from firstfix.errors import InputError, MalformedData, UnsupportedFormat
from firstfix.transform import from_quaternion, transform_points
from firstfix_builder.sources.read_map import read_map, read_parts

RNG = np.random.default_rng(4)
A, B = RNG.uniform(-20, 20, (30, 3)).astype("<f4"), RNG.uniform(-20, 20, (50, 3)).astype("<f4")


def write_pcd(path, rows, fields="x y z"):
    count = len(fields.split())
    header = f"FIELDS {fields}\nSIZE {'4 ' * count}\nTYPE {'F ' * count}\nPOINTS {len(rows)}\nDATA binary\n"
    path.write_bytes(header.replace("POINTS", f"WIDTH {len(rows)}\nHEIGHT 1\nPOINTS").encode())
    with path.open("ab") as file:
        file.write(np.asarray(rows, "<f4").tobytes())


@pytest.mark.parametrize(
    ("parts", "others"),
    [
        (("GlobalMap.pcd",), ("CornerMap.pcd", "SurfMap.pcd")),
        (("CornerMap.pcd", "SurfMap.pcd"), ()),
        (("CornerMap.pcd",), ()),
        (("finalCloud.pcd",), ("cornerMap.pcd", "surfaceMap.pcd")),
        (("cornerMap.pcd", "surfaceMap.pcd"), ()),
        (("map.pcd", "ground.pcd"), ()),
        (("corner.pcd", "surf.pcd"), ()),
        (("cloudGlobal.pcd",), ("cloudCorner.pcd", "cloudSurf.pcd")),
        (("cloudCorner.pcd", "cloudSurf.pcd"), ()),
        (("scans.pcd",), ()),
        (("anything.pcd",), ()),
    ],
)
def test_the_clouds_of_a_package_are_merged(tmp_path, parts, others):
    for name, cloud in zip(parts, (A, B), strict=False):
        write_pcd(tmp_path / name, cloud)
    for name in others:  # parts of a whole that is there as well
        write_pcd(tmp_path / name, np.zeros((9, 3)))
    (tmp_path / "notes.md").write_text("x")
    data = read_map(tmp_path)
    np.testing.assert_array_equal(data.points, np.concatenate([A, B][: len(parts)]))
    assert data.trajectory is None
    named = [one.what for one in data.read.left_out]
    assert named == (["SurfMap.pcd"] if parts == ("CornerMap.pcd",) else [])


def test_lio_sams_poses(tmp_path):
    write_pcd(tmp_path / "GlobalMap.pcd", A)
    roll, pitch, yaw = 0.1, -0.2, 2.0
    write_pcd(tmp_path / "transformations.pcd", [[1, 2, 3, roll, pitch, yaw]], "x y z roll pitch yaw")
    write_pcd(tmp_path / "trajectory.pcd", [[7, 7, 7]])
    pose = read_map(tmp_path).trajectory
    half = np.array([roll, pitch, yaw]) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    quaternion = [  # Rz(yaw) Ry(pitch) Rx(roll) as every textbook has it
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]
    np.testing.assert_allclose(pose, [from_quaternion([1, 2, 3], quaternion)], atol=1e-6)


def test_livox_key_frames(tmp_path):
    write_pcd(tmp_path / "corner.pcd", A)
    (tmp_path / "key_frame.txt").write_text("0 0 0.7071068 0.7071068 1 2 3\n0 0 0 1 4 5 6\n")
    poses = read_map(tmp_path).trajectory
    np.testing.assert_allclose(poses[0], from_quaternion([1, 2, 3], [0, 0, 1, 1]), atol=1e-6)
    np.testing.assert_allclose(poses[1], from_quaternion([4, 5, 6], [0, 0, 0, 1]))


def write_glim(folder, clouds, poses, compact=True):
    for index, (cloud, T) in enumerate(zip(clouds, poses, strict=True)):
        submap = folder / f"{index:06d}"
        submap.mkdir()
        rows = "\n".join(" ".join(f"{v:.9f}" for v in row) for row in T)
        eye = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1"
        (submap / "data.txt").write_text(
            f"id: {index}\nT_world_origin: \n{rows}\nT_origin_endpoint_L: \n{eye}\nnum_frames: 0\n"
        )
        if compact:
            (submap / "points_compact.bin").write_bytes(cloud.astype("<f4").tobytes())
        else:
            (submap / "points.bin").write_bytes(np.c_[cloud, np.ones(len(cloud))].astype("<f8").tobytes())


POSES = [from_quaternion([5, 6, 7], [0.1, 0.2, 0.3, 0.9]), from_quaternion([-50, 3, 0], [0, 0, 1, 0.2])]


@pytest.mark.parametrize("compact", [True, False])
def test_glims_submaps_stand_where_their_poses_say(tmp_path, compact):
    write_glim(tmp_path, [A, B], POSES, compact)
    data = read_map(tmp_path)
    expected = np.concatenate([transform_points(POSES[0], A), transform_points(POSES[1], B)])
    np.testing.assert_allclose(data.points, expected, atol=1e-6)
    np.testing.assert_allclose(data.trajectory, POSES, atol=1e-6)


def test_glims_optimised_trajectory_goes_before_the_submaps_origins(tmp_path):
    write_glim(tmp_path, [A, B], POSES)
    (tmp_path / "traj_lidar.txt").write_text("1.5 1 2 3 0 0 0 1\n1.6 2 3 4 0 0 0 1\n1.7 3 4 5 0 0 0 1\n")
    np.testing.assert_array_equal(read_map(tmp_path).trajectory[:, :3, 3], [[1, 2, 3], [2, 3, 4], [3, 4, 5]])


def test_a_damaged_submap_is_named(tmp_path):
    write_glim(tmp_path, [A, B], POSES)
    points, pose = tmp_path / "000001" / "points_compact.bin", tmp_path / "000001" / "data.txt"
    whole = points.read_bytes()
    points.write_bytes(whole[:-1])
    with pytest.raises(MalformedData, match=r"000001: points_compact\.bin: .* rows of 12 bytes"):
        read_map(tmp_path)
    points.write_bytes(whole)
    text = pose.read_text()
    for damaged in ("", "id: 1\n", text[:60], text.replace("T_world_origin: \n", "T_world_origin: \n2 ")):
        pose.write_text(damaged)
        with pytest.raises(MalformedData, match=r"000001: data\.txt: "):
            read_map(tmp_path)


def test_a_damaged_cloud_of_a_folder_is_named(tmp_path):
    write_pcd(tmp_path / "corner.pcd", A)
    (tmp_path / "surf.pcd").write_bytes((tmp_path / "corner.pcd").read_bytes()[:-5])
    with pytest.raises(MalformedData, match=r"surf\.pcd: PCD: .* cut off"):
        read_map(tmp_path)


def test_a_folder_of_no_map_or_of_several_is_refused(tmp_path):
    with pytest.raises(UnsupportedFormat, match="0 map files"):
        read_map(tmp_path)
    write_pcd(tmp_path / "one.pcd", A)
    write_pcd(tmp_path / "two.pcd", B)
    with pytest.raises(UnsupportedFormat, match="2 map files"):
        read_map(tmp_path)


def mesh_folder(folder: Path, shift: np.ndarray) -> list[np.ndarray]:
    """Two files of a triangle each, UTM-sized, and poses."""
    folder.mkdir()
    corners = [
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]),
        np.array([[60, 0, 0], [61, 0, 0], [60, 1, 2.0]]),
    ]
    for name, one in zip(("b.ply", "a.obj"), corners, strict=True):
        trimesh.Trimesh(one + shift, [[0, 1, 2]], process=False).export(folder / name)
    (folder / "poses.txt").write_text(f"0 {shift[0] + 1} {shift[1]} 1 0 0 0 1\n")
    return [one + shift for one in corners]


def test_a_folder_of_meshes_is_one_map_file_by_file(tmp_path):
    b, a = mesh_folder(tmp_path / "city", np.array([400_060.0, 5_000_030.0, 0.0]))
    parts = list(read_parts(tmp_path / "city"))
    for part, corners in zip(parts, (a, b), strict=True):
        vertices, triangles = part.surface
        np.testing.assert_array_equal(part.origin, [400_100.0, 5_000_000.0, 0.0])
        np.testing.assert_allclose(vertices[triangles[0]] + part.origin, corners, atol=0.6)
    assert parts[0].trajectory is not None
    np.testing.assert_allclose(parts[0].trajectory[0, :3, 3], [-39, 30, 1], atol=0.6)
    assert parts[1].trajectory is None


def test_a_folder_with_one_mesh_or_a_cloud_among_meshes_is_no_folder_of_meshes(tmp_path):
    mesh_folder(tmp_path / "city", np.zeros(3))
    (tmp_path / "city" / "a.obj").rename(tmp_path / "a.obj")
    (part,) = read_parts(tmp_path / "city")
    assert len(part.surface[1]) == 1
    np.save(tmp_path / "city" / "cloud.npy", np.zeros((5, 3)))
    with pytest.raises(UnsupportedFormat, match="has 2 map files"):
        list(read_parts(tmp_path / "city"))
    shutil.rmtree(tmp_path / "city")
    mesh_folder(tmp_path / "city", np.zeros(3))
    (tmp_path / "city" / "b.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\nelement face 1\n")
    with pytest.raises(InputError, match=r"b\.ply|2 map files"):
        list(read_parts(tmp_path / "city"))


def test_a_map_tells_whether_its_trajectory_was_given_or_came_with_it(tmp_path):
    write_pcd(tmp_path / "corner.pcd", A)
    (tmp_path / "key_frame.txt").write_text("0 0 0 1 4 5 6\n")
    (tmp_path.parent / "given.txt").write_text("0 1 2 3 0 0 0 1\n")
    assert read_map(tmp_path).trajectory_source == "file"
    given = read_map(tmp_path, trajectory=tmp_path.parent / "given.txt")
    assert (given.trajectory_source, given.read.poses) == ("given", "given.txt")
