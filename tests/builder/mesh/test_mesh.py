from __future__ import annotations

from pathlib import Path

import numpy as np

from firstfix_builder.mesh.mesh import Mesh

TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))


def test_joined_meshes_keep_their_corners():
    joined = Mesh.joined([TRIANGLE, Mesh.empty(), Mesh(TRIANGLE.vertices + 5, TRIANGLE.triangles)])
    np.testing.assert_array_equal(joined.triangles, [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(joined.vertices[joined.triangles[1]], np.eye(3) + 5)
    assert len(Mesh.joined([]).triangles) == 0


def test_unused_vertices_go_with_their_triangles():
    joined = Mesh.joined([TRIANGLE, Mesh(TRIANGLE.vertices + 5, TRIANGLE.triangles)])
    kept = joined.with_triangles(np.array([False, True]))
    np.testing.assert_array_equal(kept.triangles, [[0, 1, 2]])
    np.testing.assert_array_equal(kept.vertices, np.eye(3) + 5)


def test_saved_bytes_depend_on_the_mesh_alone(tmp_path: Path):
    TRIANGLE.save(tmp_path / "a")
    Mesh.load(tmp_path / "a").save(tmp_path / "b")
    for name in ("vertices.npy", "triangles.npy"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    np.testing.assert_array_equal(Mesh.load(tmp_path / "b").vertices, TRIANGLE.vertices)
