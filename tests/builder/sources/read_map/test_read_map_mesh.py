from __future__ import annotations

import numpy as np
import pytest
import trimesh

from firstfix.errors import MalformedData
from firstfix_builder.sources.read_map import read_map

BOX = trimesh.creation.box((4.0, 3.0, 2.0))
FORMATS = ("ply", "obj", "stl", "glb")


def corners_of(data):
    """The (t, 3, 3) corners of the triangles, in an order that no format can change."""
    corners = data.vertices[data.triangles]
    return np.sort(corners.sum(axis=1) @ [1, 10, 100])


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_mesh_comes_back(tmp_path, suffix):
    BOX.export(tmp_path / f"box.{suffix}")
    data = read_map(tmp_path / f"box.{suffix}")
    assert data.points is None
    assert data.vertices.shape == (8, 3)  # STL repeats them; they are merged
    assert data.triangles.shape == (12, 3)
    assert data.triangles.dtype == np.int64
    np.testing.assert_allclose(corners_of(data), np.sort(BOX.triangles.sum(axis=1) @ [1, 10, 100]), atol=1e-5)


def test_parts_of_a_scene_become_one_mesh_where_they_stand(tmp_path):
    other = trimesh.creation.box((1.0, 1.0, 1.0))
    scene = trimesh.Scene([BOX])
    scene.add_geometry(other, transform=trimesh.transformations.translation_matrix([10, 0, 0]))
    scene.export(tmp_path / "scene.glb")
    data = read_map(tmp_path / "scene.glb")
    assert len(data.triangles) == 24
    np.testing.assert_allclose(data.vertices[:, 0].max(), 10.5)


def test_squares_are_cut_into_triangles(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(header + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n")
    data = read_map(tmp_path / "a.ply")
    assert data.triangles.shape == (2, 3)
    area = trimesh.Trimesh(data.vertices, data.triangles).area
    assert area == pytest.approx(1.0)


def test_utm_vertices_keep_their_millimetres(tmp_path):
    shift = np.array([512_345.678, 5_403_210.123, 295.5])
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in BOX.vertices + shift]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in BOX.faces]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    rows = "\n".join(lines[:8]).replace("v ", "")
    header = "ply\nformat ascii 1.0\nelement vertex 8\n" + "".join(f"property double {a}\n" for a in "xyz")
    header += "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    faces = "\n".join(f"3 {a} {b} {c}" for a, b, c in BOX.faces)
    (tmp_path / "a.ply").write_text(f"{header}{rows}\n{faces}\n")
    for name in ("a.obj", "a.ply"):
        data = read_map(tmp_path / name)
        np.testing.assert_array_equal(data.origin, [512_300, 5_403_200, 0])
        low = BOX.vertices.min(axis=0) + shift
        np.testing.assert_allclose((data.vertices + data.origin).min(axis=0), low, atol=0.001)


def test_a_y_up_mesh_is_turned(tmp_path):
    BOX.export(tmp_path / "box.glb")
    size = np.ptp(read_map(tmp_path / "box.glb", axis="y-up").vertices, axis=0)
    np.testing.assert_allclose(size, [2.0, 4.0, 3.0], atol=1e-6)


@pytest.mark.parametrize("suffix", FORMATS)
def test_cut_off_empty_and_senseless_meshes_name_the_file(tmp_path, suffix):
    path = tmp_path / f"box.{suffix}"
    trimesh.creation.icosphere(subdivisions=3).export(path)
    whole = path.read_bytes()
    shares = (0.01, 0.3) if suffix == "obj" else (0.01, 0.3, 0.7, 0.99)  # cut late, an OBJ is a smaller OBJ
    for content in (b"", b"\0" * 1000, b"hello\n", *(whole[: int(len(whole) * share)] for share in shares)):
        path.write_bytes(content)
        with pytest.raises(MalformedData, match=rf"^box\.{suffix}: ."):
            read_map(path)


def test_triangles_of_missing_vertices_are_malformed(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
    for face in ("3 0 1 7", "3 0 1 -5"):
        (tmp_path / "a.ply").write_text(header + face + "\n")
        with pytest.raises(MalformedData, match=r"^a\.ply: "):
            read_map(tmp_path / "a.ply")


def test_triangles_of_nan_are_dropped(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\n")
    data = read_map(tmp_path / "a.obj")
    assert data.triangles.shape == (1, 3)
    assert np.isfinite(data.vertices).all()


def test_a_cloud_in_a_file_for_meshes_is_named(tmp_path):
    """As MeshLab 2025.7 saves a cloud as OBJ, and trimesh 5.2 as GLB."""
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    trimesh.PointCloud(BOX.vertices).export(tmp_path / "a.glb")
    for name in ("a.obj", "a.glb"):
        with pytest.raises(MalformedData, match=r"[38] points and no triangle: a cloud .* save it as PLY"):
            read_map(tmp_path / name)
