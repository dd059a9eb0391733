from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.poisson import clip_mesh


def area_vectors(mesh: Mesh) -> NDArray[np.float64]:
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    vectors: NDArray[np.float64] = np.cross(b - a, c - a) / 2
    return vectors


def soup(seed: int) -> Mesh:
    vertices = np.random.default_rng(seed).normal(size=(300, 3))
    return Mesh(vertices, np.arange(300).reshape(100, 3))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_two_sides_add_up_to_the_whole(axis: int):
    mesh = soup(axis)
    below, above = clip_mesh(mesh, axis, 0.1, keep_below=True), clip_mesh(mesh, axis, 0.1, keep_below=False)
    assert below.vertices[:, axis].max() <= 0.1
    assert above.vertices[:, axis].min() >= 0.1
    # area and winding: the vector area is kept, and so is the plain one
    np.testing.assert_allclose(
        area_vectors(below).sum(0) + area_vectors(above).sum(0), area_vectors(mesh).sum(0)
    )
    plain = sum(np.linalg.norm(area_vectors(part), axis=1).sum() for part in (below, above))
    assert plain == pytest.approx(np.linalg.norm(area_vectors(mesh), axis=1).sum())


def test_a_triangle_with_one_corner_over_the_plane_becomes_two():
    mesh = Mesh(np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]]))
    kept = clip_mesh(mesh, 0, 1.0, keep_below=True)
    assert len(kept.triangles) == 2
    assert np.linalg.norm(area_vectors(kept), axis=1).sum() == pytest.approx(1.5)
    assert len(clip_mesh(mesh, 0, 1.0, keep_below=False).triangles) == 1


def test_a_plane_beside_the_mesh_keeps_all_or_nothing():
    mesh = soup(5)
    assert len(clip_mesh(mesh, 2, 100.0, keep_below=True).triangles) == 100
    assert len(clip_mesh(mesh, 2, 100.0, keep_below=False).triangles) == 0
    assert len(clip_mesh(Mesh.empty(), 2, 0.0, keep_below=True).triangles) == 0
