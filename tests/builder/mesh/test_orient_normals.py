from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.orient_normals import estimate_normals, orient_normals
from tests.builder.box_scenes import box, floor, sampled, walls

VOXEL_M = 0.15


def oriented(points: NDArray[np.float64], places: NDArray[np.float64] | None) -> NDArray[np.float64]:
    return orient_normals(points, estimate_normals(points, 0.3, 20), places, VOXEL_M)


def room_points() -> NDArray[np.float64]:
    """The inner faces of a room of 8 x 6 x 3 m: what a scanner in it sees."""
    points = sampled(box((0, 0, 0), (8, 6, 3)), 150)
    from_edge = np.sort(np.minimum(points, np.array([8, 6, 3]) - points), axis=1)
    return points[from_edge[:, 1] > 0.3]  # away from edges, where a normal is a compromise


def share_inwards(points: NDArray[np.float64], normals: NDArray[np.float64]) -> float:
    return float(np.mean(np.einsum("ni,ni->n", normals, np.array([4, 3, 1.5]) - points) > 0))


def test_a_room_faces_its_scanner():
    points = room_points()
    places = np.array([[2.0, 2, 1], [6, 4, 1]])
    assert share_inwards(points, oriented(points, places)) == 1.0


def test_a_room_faces_inwards_without_a_trajectory():
    points = room_points()
    assert share_inwards(points, oriented(points, None)) > 0.99


def test_a_ceiling_faces_the_storey_below_though_the_scanner_above_came_nearer():
    lower, upper = floor(0, 0, 8, 6), floor(0, 0, 8, 6, 3.3)
    ceiling = floor(0, 0, 8, 6, 2.9)
    points = sampled(Mesh.joined([lower, ceiling, upper]), 200)
    x = np.arange(0.5, 8, 0.5)
    places = np.concatenate([np.column_stack([x, 0 * x + 3, 0 * x + z]) for z in (0.9, 4.2)])
    normals = oriented(points, places)
    up = normals[:, 2] > 0
    is_ceiling = np.abs(points[:, 2] - 2.9) < 0.01
    assert np.mean(~up[is_ceiling]) > 0.98
    assert np.mean(up[~is_ceiling]) > 0.98


def test_facades_face_the_street_without_a_trajectory():
    # ground with a hall whose inside nobody has seen
    outside = Mesh.joined(walls(10, 10, 18, 16, 5))
    points = sampled(outside, 100)
    away = np.maximum(np.abs(points[:, :2] - [14, 13]) - [4.05, 3.05], 0).max(axis=1)
    facade = points[(away > 0.04) & (points[:, 2] > 0.3) & (points[:, 2] < 4.7)]
    ground = sampled(floor(0, 0, 28, 26), 60)
    ground = ground[(np.abs(ground[:, :2] - [14, 13]) > [4.3, 3.3]).any(axis=1)]
    normals = oriented(np.concatenate([facade, ground]), None)[: len(facade)]
    outwards = np.einsum("ni,ni->n", normals[:, :2], facade[:, :2] - [14, 13])
    assert np.mean(outwards > 0) > 0.98


def test_nothing_flat_anywhere_still_gives_unit_normals():
    points = np.random.default_rng(0).normal(size=(500, 3)) * [0.01, 1, 5]
    normals = oriented(points, None)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
