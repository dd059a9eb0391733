"""The surface of the default engine: what a reconstruction must not do to plain scenes, and its blocks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.config import ReconstructConfig
from firstfix.errors import BuildFailed
from firstfix_builder.mesh.map_tiles import Block
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.reconstruct import mesh_chunks
from firstfix_builder.mesh.signed_distance import Sampling, signed_distance_mesh
from firstfix_builder.simulation.simulate import Simulator, upright

SPACING_M = 0.1
CELL_M = 1.4 * SPACING_M
SAMPLING = Sampling(1.1 * SPACING_M, 3.0, 0.9 * SPACING_M)  # as measured where the points fall at random
EVERYWHERE = Block(np.array([-100.0, -100.0]), np.array([100.0, 100.0]))


def plane(low: list[float], high: list[float], seed: int = 0) -> NDArray[np.float64]:
    """Points on a rectangle that stands square to an axis, one for each square of the spacing, 1 cm noise."""
    low_m, size = np.array(low, float), np.array(high, float) - low
    area = np.prod(size[size > 0])
    rng = np.random.default_rng(seed)
    points = low_m + rng.random((int(area / SPACING_M**2), 3)) * size
    return points + rng.normal(0, 0.01, points.shape)


def surface(
    points: NDArray[np.float64],
    places: list[list[float]] | None,
    block: Block = EVERYWHERE,
) -> Mesh:
    return signed_distance_mesh(
        points,
        None if places is None else np.array(places, float),
        block,
        cell_m=CELL_M,
        sampling=SAMPLING,
        trim_m=1.75 * SPACING_M,
        sight_voxel_m=1.8 * SPACING_M,
    )


def ranges(mesh: Mesh, origins: NDArray[np.float64], direction: list[float]) -> NDArray[np.float32]:
    return Simulator(mesh.vertices, mesh.triangles).cast(origins, np.broadcast_to(direction, origins.shape))


def grid(low: list[float], high: list[float], step_m: float = 0.05) -> NDArray[np.float64]:
    axes = [np.arange(a, b + 1e-9, step_m) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def test_a_flat_wall_has_no_hole_and_stands_where_it_is():
    mesh = surface(plane([3, -2, 0], [3, 2, 2]), [[0, 0, 1]])
    away_m = ranges(mesh, grid([0, -1.8, 0.2], [0, 1.8, 1.8]), [1, 0, 0])
    assert np.isfinite(away_m).all()
    assert abs(np.median(away_m) - 3) < 0.01
    assert np.abs(away_m - 3).max() < 0.06


def test_a_corner_stays_closed():
    walls = np.concatenate([plane([2, -2, 0], [2, 2, 2]), plane([-2, 2, 0], [2, 2, 2], 1)])
    mesh = surface(walls, [[0, 0, 1]])
    origins = grid([0, 0, 0.3], [0, 0, 1.7])
    for angle in np.radians(np.arange(10, 80)):
        direction = [float(np.cos(angle)), float(np.sin(angle)), 0.0]
        away_m = ranges(mesh, origins, direction)
        assert np.abs(away_m - 2 / max(direction)).max() < 0.2


def test_a_wall_with_two_faces_is_not_thicker():
    faces = np.concatenate([plane([2, -2, 0], [2, 2, 2]), plane([2.3, -2, 0], [2.3, 2, 2], 1)])
    mesh = surface(faces, [[0, 0, 1], [4.3, 0, 1]])
    front = ranges(mesh, grid([0, -1.7, 0.3], [0, 1.7, 1.7]), [1, 0, 0])
    back = ranges(mesh, grid([4.3, -1.7, 0.3], [4.3, 1.7, 1.7]), [-1, 0, 0])
    assert abs(np.median(front) - 2) < 0.03
    assert abs(np.median(back) - 2) < 0.03


def test_a_door_stays_open():
    wall = plane([3, -2, 0], [3, 2, 2.5])
    door = (np.abs(wall[:, 1]) < 0.45) & (wall[:, 2] < 2)
    mesh = surface(wall[~door], [[0, 0, 1]])
    assert np.isinf(ranges(mesh, grid([0, -0.3, 0.2], [0, 0.3, 1.8]), [1, 0, 0])).all()
    assert np.isfinite(ranges(mesh, grid([0, 0.6, 0.2], [0, 1.8, 2.3]), [1, 0, 0])).all()


def test_rings_that_are_two_spacings_apart_close():
    rng = np.random.default_rng(3)
    rings = np.arange(0, 4, 2 * SPACING_M)
    floor = np.stack(np.meshgrid(np.arange(0, 4, SPACING_M / 2), rings), axis=-1).reshape(-1, 2)
    points = np.column_stack([floor, np.zeros(len(floor))]) + rng.normal(0, 0.005, (len(floor), 3))
    away_m = ranges(surface(points, [[2, 2, 1.5]]), grid([0.4, 0.4, 1.0], [3.4, 3.4, 1.0]), [0, 0, -1])
    assert np.isfinite(away_m).mean() > 0.995
    assert np.abs(away_m - 1)[np.isfinite(away_m)].max() < 0.05


def passers_by(count: int = 130) -> NDArray[np.float64]:
    """Returns in the air before a wall: a fifth of its points in each cell."""
    return np.random.default_rng(5).uniform([1.2, -1, 0.5], [1.9, 1, 1.5], (count, 3))


def test_thin_returns_beside_the_scanner_are_no_surface():
    wall, air = plane([3, -2, 0], [3, 2, 2]), passers_by()
    origins = grid([0, -0.8, 0.6], [0, 0.8, 1.4])
    away_m = ranges(surface(np.concatenate([wall, air]), [[0, 0, 1]]), origins, [1, 0, 0])
    assert np.mean(np.abs(away_m - 3) < 0.06) > 0.95
    # Without a place, nobody knows how dense the points would be: they stay.
    unknown_m = ranges(surface(np.concatenate([wall, air]), None), origins, [1, 0, 0])
    assert np.mean(unknown_m < 2.5) > 0.3


def test_a_surface_far_from_the_scanner_may_be_thin():
    wall = plane([12, -2, 0], [12, 2, 2])
    thin = wall[np.random.default_rng(6).random(len(wall)) < 0.25]
    origins = grid([11, -1.8, 0.2], [11, 1.8, 1.8])
    far_m = ranges(surface(thin, [[0, 0, 1]]), origins, [1, 0, 0])
    assert np.isfinite(far_m).mean() > 0.5
    assert len(surface(thin, [[10, 0, 1]]).triangles) < 0.2 * len(surface(thin, [[0, 0, 1]]).triangles)


def test_blocks_side_by_side_are_the_surface_as_a_whole():
    points = np.concatenate([plane([-4, -4, 0], [4, 4, 0]), plane([1, -4, 0], [1, 4, 2], 1)])
    places = [[-1, 0, 1.5], [3, 0, 1.5]]
    whole = surface(points, places)
    parts = []
    for low in np.array([[x, y] for x in (-8, 0) for y in (-8, 0)], float):
        block = Block(low, low + 8.0)
        parts.append(surface(points[block.holds(points, 12 * CELL_M)], places, block))
    joined = Mesh.joined(parts)
    assert len(joined.triangles) == len(whole.triangles)

    def corners(mesh: Mesh) -> NDArray[np.float64]:
        flat = mesh.vertices[mesh.triangles].reshape(-1, 9)
        return flat[np.lexsort(flat.T)]

    assert (corners(joined) == corners(whole)).all()  # to the last bit


def test_a_change_far_away_leaves_a_blocks_work_as_it_was():
    points = np.concatenate([plane([0, 0, 0], [60, 10, 0]), plane([0, 5, 0], [60, 5, 2], 1)])
    poses = upright(np.array([[x, 5.0, 1.5] for x in range(60)]))
    config = ReconstructConfig(surface="signed-distance", tile_cells=64)
    before = mesh_chunks(points, poses, config)
    added = np.concatenate([points, plane([56, 2, 0], [56, 4, 2], 2), plane([60, 2, 0], [63, 4, 0], 3)])
    after = mesh_chunks(added, poses, config)
    assert len(before) > 8
    assert all(chunk in after for chunk in before)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 30])
def test_few_points_are_no_surface_or_a_small_one(count: int):
    points = np.random.default_rng(4).random((count, 3))
    mesh = surface(points, [[0, 0, 3]])
    assert np.isfinite(mesh.vertices).all()
    if count < 3:
        assert len(mesh.triangles) == 0


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e9])
def test_points_without_a_cell_are_refused(wrong: float):
    points = plane([0, 0, 0], [2, 2, 0])
    points[7, 2] = wrong
    with pytest.raises(BuildFailed, match=r"no surface of cells of 0\.14 m"):
        surface(points, [[0, 0, 1]])
