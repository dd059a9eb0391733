"""Seen-free space of a mapping run: which poses carve, and what their chunks give together."""

from __future__ import annotations

import numpy as np
import pytest

import tests.reference.seen_free as oracle
from firstfix.engine.config import RegistrationConfig
from firstfix.native import CarvedCells
from firstfix.sensor import preset
from firstfix_builder.index.carve import (
    APART_M,
    carve_chunks,
    cell_width_m,
    merged,
    poses_needed,
    seen_free,
    thinned,
)
from firstfix_builder.simulation.simulate import upright

CELL_M = 0.1


def along_x(step_m: float, count: int) -> np.ndarray:
    return upright(np.arange(count)[:, None] * np.array([step_m, 0.0, 0.0]))


def one_ray(y: float) -> dict[str, np.ndarray]:
    """Bricks that a pose carves with one ray along x."""
    cells = CarvedCells(CELL_M)
    cells.add(np.array([[0.05, y, 0.05]]), np.float32([[1, 0, 0]]), np.float32([[1.3]]), 0.3)
    brick, once, twice = cells.bricks()
    return {"brick": brick, "once": once, "twice": twice}


def test_poses_are_half_a_metre_apart():
    kept = thinned(along_x(0.1, 100)[:, :3, 3])
    assert len(kept) == 20
    assert np.diff(kept[:, 0]).min() >= APART_M - 1e-9


def test_a_robot_that_stands_still_carves_once():
    assert len(thinned(np.zeros((50, 3)))) == 1


@pytest.mark.parametrize(("step_m", "needed"), [(0.1, 2), (1.9, 2), (2.1, 1), (8.0, 1)])
def test_two_poses_are_needed_but_of_sparse_stations_one(step_m, needed):
    assert poses_needed(along_x(step_m, 9)) == needed
    assert poses_needed(along_x(step_m, 1)) == 1


@pytest.mark.parametrize(
    ("voxel_m", "cell_m"), [(0.1, 0.1), (0.125, 0.1), (0.25, 0.2), (0.3, 0.24), (2.0, 0.25)]
)
def test_cells_follow_the_points_of_the_map(voxel_m, cell_m):
    assert cell_width_m(RegistrationConfig(map_voxel_m=voxel_m)) == pytest.approx(cell_m)


def test_each_tile_s_poses_are_a_chunk():
    chunks = carve_chunks(along_x(1.0, 150), preset("vlp-16"), RegistrationConfig())
    assert [chunk.tile for chunk in chunks] == [(0, 0), (1, 0), (2, 0)]
    assert sum(len(chunk.poses) for chunk in chunks) == 150


@pytest.mark.parametrize("ys", [(0.05, 0.05, 0.25), (0.25, 0.05, 0.05), (0.05, 0.25, 0.05)])
def test_what_two_chunks_saw_free_counts_twice(ys):
    parts = [one_ray(y) for y in ys]
    twice = oracle.cells_in(**merged(iter(parts), 2))
    assert twice == {(x, 0, 0) for x in range(11)}
    once = oracle.cells_in(**merged(iter(parts), 1))
    assert once == twice | {(x, 2, 0) for x in range(11)}


def test_cells_around_a_point_of_the_map_are_not_free():
    carved = merged([one_ray(0.05), one_ray(0.05)], 2)
    free = seen_free(carved, np.array([[0.55, 0.15, 0.05]]), RegistrationConfig(map_voxel_m=0.125))
    at = np.arange(11)[:, None] * np.float32([0.1, 0, 0]) + np.float32([0.05, 0.05, 0.05])
    found = [free.shares(point[None], np.eye(4)[None])[0] == 1 for point in at]
    assert found == [True] * 4 + [False] * 3 + [True] * 4
