"""Kernels of a map's surface: planes of cells, and the net where the distance from them is zero."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import firstfix.native as native
import tests.reference.mesh as oracle

CELL_M = 0.25
REACH, TRIM = 2.0, 1.25


def room(count: int, seed: int) -> NDArray[np.float64]:
    """Points of a floor and a wall with noise, and some of nothing."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-1, -1, 0], [1, 1, 2], (count, 3))
    points[: count // 2, 2] = 0.03
    points[count // 2 : -count // 20, 0] = 0.51
    return points + rng.normal(0, 0.01, points.shape)


def towards(
    means: NDArray[np.float64], normals: NDArray[np.float64], place: list[float]
) -> NDArray[np.float64]:
    return normals * np.where(((place - means) * normals).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)


@pytest.mark.parametrize("seed", range(3))
def test_planes_of_cells_are_those_of_the_reference(seed: int):
    points = room(700, seed)
    means, normals, weights, supports, best = native.cell_planes(points, CELL_M)
    expected, axes, number, around, highest, variance = oracle.cell_planes(points, CELL_M)
    assert np.allclose(means, expected, atol=1e-12)
    assert (weights == number).all()
    assert (supports == around).all()  # eighths: exact
    assert (best == highest).all()
    clear = variance[:, 1] > 1.2 * variance[:, 0] + 1e-9
    assert clear.mean() > 0.8
    assert (np.abs((normals * axes).sum(axis=1))[clear] > 1 - 1e-6).all()
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)


@pytest.mark.parametrize("seed", range(3))
def test_a_net_is_that_of_the_reference(seed: int):
    means, normals, weights, *_ = native.cell_planes(room(500, seed), CELL_M)
    normals = towards(means, normals, [-0.5, 0.0, 1.0])
    near = means[means[:, 1] < 0.3]
    vertices, triangles = native.surface_net(means, normals, weights, near, CELL_M, REACH, TRIM)
    expected, quadrangles = oracle.surface_net(means, normals, weights, near, CELL_M, REACH, TRIM)
    assert len(quadrangles) > 30
    cells = list(map(tuple, np.floor(vertices / CELL_M).astype(int).tolist()))
    assert sorted(cells) == sorted(expected)
    assert np.allclose(vertices, [expected[cell] for cell in cells], atol=1e-9)

    def turned(ring: list[tuple[int, int, int]]) -> tuple[tuple[int, int, int], ...]:
        first = ring.index(min(ring))
        return tuple(ring[first:] + ring[:first])

    first, second = triangles[::2], triangles[1::2]
    assert (first[:, [0, 2]] == second[:, [0, 1]]).all()
    rings = np.column_stack([first, second[:, 2]]).tolist()
    made = sorted(turned([cells[corner] for corner in ring]) for ring in rings)
    assert made == sorted(turned(list(ring)) for ring in quadrangles)


def test_triangles_face_free_space():
    points = room(3000, 7)
    points[:, 0] = -5  # a wall at x = -5, seen from the origin
    means, normals, weights, *_ = native.cell_planes(points, CELL_M)
    vertices, triangles = native.surface_net(
        means, towards(means, normals, [0, 0, 1]), weights, means, CELL_M, REACH, TRIM
    )
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    assert (np.cross(b - a, c - a)[:, 0] > 0).all()


def test_few_points_make_no_planes_and_no_net():
    for points in (np.zeros((0, 3)), np.ones((1, 3)), np.ones((2, 3))):
        planes = native.cell_planes(points, CELL_M)
        assert [len(part) for part in planes] == [0, 0, 0, 0, 0]
        assert [len(part) for part in native.surface_net(*planes[:3], points, CELL_M, REACH, TRIM)] == [0, 0]


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e300, CELL_M * 2**20])
def test_points_that_have_no_cell_are_refused(wrong: float):
    points = np.zeros((9, 3))
    points[4, 1] = wrong
    with pytest.raises(ValueError, match="not finite, or too many cells away"):
        native.cell_planes(points, CELL_M)
    with pytest.raises(ValueError, match="not finite, or too many cells away"):
        native.surface_net(points, np.zeros((9, 3)), np.ones(9), points[:3], CELL_M, REACH, TRIM)
    with pytest.raises(ValueError, match="not finite, or too many cells away"):
        native.surface_net(points[:3], np.zeros((3, 3)), np.ones(3), points, CELL_M, REACH, TRIM)


def test_invalid_limits_of_nets_are_refused():
    planes = native.cell_planes(room(300, 1), CELL_M)[:3]
    for cell_m in (0.0, -1.0, np.nan, np.inf, 1e-300):
        with pytest.raises(ValueError, match="edge of a cell"):
            native.cell_planes(room(300, 1), cell_m)
    for reach, trim in ((0, 1), (5, 1), (np.nan, 1), (1, 0), (1, 1e9), (1, np.nan)):
        with pytest.raises(ValueError, match="reach and trim"):
            native.surface_net(*planes, planes[0], CELL_M, reach, trim)
    means, normals, weights = planes
    near = means
    for bad in (np.nan, 1e9):
        with pytest.raises(ValueError, match="unit vector"):
            native.surface_net(means, normals * bad, weights, near, CELL_M, REACH, TRIM)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="weight"):
            native.surface_net(means, normals, weights * bad, near, CELL_M, REACH, TRIM)
    with pytest.raises(ValueError, match="one normal and weight"):
        native.surface_net(means, normals[1:], weights, near, CELL_M, REACH, TRIM)


def sight(seed: int) -> tuple[Any, ...]:
    """Voxels, some of them occupied, and points in and around them with directions and places."""
    rng = np.random.default_rng(seed)
    occupied = (rng.random((9, 7, 5)) < 0.2).astype(np.uint8)
    points = rng.uniform(-1.2, 1.2, (500, 3))
    outwards = rng.normal(size=(500, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    places = rng.uniform(-2, 2, (500, 3))
    places[:9] = points[:9] + 0.01
    return occupied, np.array([-5, -3, -2]), 0.2, points, outwards, places


@pytest.mark.parametrize("seed", range(3))
def test_what_is_in_sight_is_so_for_the_reference(seed: int):
    given = sight(seed)
    seen = native.in_sight(*given, 1.5, 16)
    assert (seen == oracle.in_sight(*given, 1.5, 16)).all()
    assert 0.1 < seen.mean() < 0.9


def test_invalid_voxels_have_nothing_in_sight():
    occupied, low, voxel_m, points, outwards, places = sight(0)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="size"):
            native.in_sight(occupied, low, bad, points, outwards, places, 1.5, 16)
    with pytest.raises(ValueError, match="one direction and place"):
        native.in_sight(occupied, low, voxel_m, points, outwards[1:], places, 1.5, 16)
    with pytest.raises(ValueError, match="steps"):
        native.in_sight(occupied, low, voxel_m, points, outwards, places, 1.5, 1 << 40)
    with pytest.raises(ValueError, match="far away"):
        native.in_sight(occupied, low - 2**60, voxel_m, points, outwards, places, 1.5, 16)
    unknown = np.full_like(points, np.nan)
    assert native.in_sight(occupied, low, voxel_m, unknown, outwards, places, 1.5, 16).all()


@pytest.mark.parametrize("seed", range(3))
def test_vertices_stand_in_the_order_of_their_first_use(seed: int):
    rng = np.random.default_rng(seed)
    triangles = rng.integers(0, 60, (200, 3))
    start = np.array([0, 0, 50, 130, 200])  # one tile is empty
    for found, expected in zip(
        native.by_first_use(triangles, start, 70), oracle.by_first_use(triangles, start, 70), strict=True
    ):
        assert (found == expected).all()


def test_triangles_without_their_vertices_or_tiles_are_refused():
    triangles = np.array([[0, 1, 2], [2, 1, 3]])
    for start in ([], [0], [1, 2], [0, 3], [0, 2, 1, 2]):
        with pytest.raises(ValueError, match="each triangle once"):
            native.by_first_use(triangles, np.array(start, np.int64), 4)
    with pytest.raises(ValueError, match="no vertex"):
        native.by_first_use(triangles, np.array([0, 2]), 3)
    with pytest.raises(ValueError, match="no vertex"):
        native.by_first_use(triangles - 1, np.array([0, 2]), 4)
    with pytest.raises(ValueError, match="too many vertices"):
        native.by_first_use(triangles, np.array([0, 2]), (1 << 28) + 1)


@pytest.mark.parametrize("least", [0, 1, 3, 900])
@pytest.mark.parametrize("radius_m", [0.02, 0.15, 5.0])
def test_points_with_neighbours_are_those_of_the_reference(radius_m: float, least: int):
    points = room(700, 3) - 1e3
    points[:5] = points[5]  # they coincide
    points[5:9] += [[9, 0, 0], [0, -9, 0], [0, 0, 9], [-9, 9, -9]]
    kept = native.with_neighbours(points, radius_m, least)
    assert (kept == oracle.with_neighbours(points, radius_m, least)).all()


def test_neighbours_are_nearer_than_the_radius():
    row = np.zeros((4, 3))
    row[:, 2] = [0, 0.5, 1, 1.25]
    assert native.with_neighbours(row, 0.5, 1).tolist() == [0, 0, 1, 1]
    assert len(native.with_neighbours(np.zeros((0, 3)), 0.5, 1)) == 0


def test_invalid_neighbourhoods_are_refused():
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="size"):
            native.with_neighbours(np.zeros((3, 3)), bad, 1)
    for bad in (np.nan, np.inf, -np.inf):
        with pytest.raises(ValueError, match="finite"):
            native.with_neighbours(np.array([[0.0, bad, 0.0]]), 1.0, 1)
    for apart_m in (1e7, 1e300):
        with pytest.raises(ValueError, match="too far apart"):
            native.with_neighbours(np.array([[0.0, 0, 0], [0, -apart_m, 0]]), 1.0, 1)
