"""Kernels of seen-free space: carving by rays, what the map's points take out, and a scan's share."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

import firstfix.native as native
import tests.reference.seen_free as oracle
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.transform import make_transform, rotation_z, transform_points

CELL_M, BACK_OFF_M = 0.25, 0.3


def rays(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float32]]:
    """Three poses on both sides of the frame's origin, and rays of which some have no return."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(60, 3))
    directions[:6] = [*np.eye(3), *-np.eye(3)]  # along the axes
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ranges = rng.uniform(0.1, 6, (3, 60)).astype(np.float32)
    ranges[0, 7:9], ranges[1, 9] = np.inf, np.nan
    return rng.uniform(-1, 1, (3, 3)), directions.astype(np.float32), ranges


def carved(seed: int) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    cells = native.CarvedCells(CELL_M)
    cells.add(*rays(seed), BACK_OFF_M)
    return cells.bricks()


@pytest.mark.parametrize("seed", range(3))
def test_rays_carve_the_cells_of_the_reference(seed: int):
    brick, once, twice = carved(seed)
    counts = oracle.carved(*rays(seed), BACK_OFF_M, CELL_M)
    assert oracle.cells_in(brick, once) == set(counts)
    assert oracle.cells_in(brick, twice) == {cell for cell, poses in counts.items() if poses >= 2}
    assert brick.tolist() == sorted(brick.tolist())


def test_rays_carve_beyond_a_brick_that_is_free_already():
    rng = np.random.default_rng(0)
    origins = rng.uniform(0.9, 1.1, (5, 3))
    directions = rng.normal(size=(5, 512, 3))
    ranges = np.full((5, 512), 4.0)
    middles = (np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), axis=1) + 0.5) * CELL_M
    directions[:2] = middles - origins[:2, None]  # the first two poses see all of one brick
    ranges[:2] = np.linalg.norm(directions[:2], axis=2) + BACK_OFF_M + 0.01
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    cells = native.CarvedCells(CELL_M)
    counts: Counter[oracle.Cell] = Counter()
    for number, rays_of_pose in enumerate(
        zip(origins[:, None], directions.astype(np.float32), ranges.astype(np.float32)[:, None], strict=True)
    ):
        cells.add(*rays_of_pose, BACK_OFF_M)
        counts.update(oracle.carved(*rays_of_pose, BACK_OFF_M, CELL_M).keys())
        brick, once, twice = cells.bricks()
        is_full = (twice[(brick == 0).all(axis=1)] == -1).all()
        assert is_full == (number >= 1)
    assert oracle.cells_in(brick, once) == set(counts)
    assert oracle.cells_in(brick, twice) == {cell for cell, poses in counts.items() if poses >= 2}


def test_rays_of_one_pose_count_once():
    origins, directions, ranges = rays(0)
    cells = native.CarvedCells(CELL_M)
    cells.add(origins[:1], np.concatenate([directions, directions]), np.tile(ranges[:1], (1, 2)), BACK_OFF_M)
    assert not cells.bricks()[2].any()


def test_points_of_the_map_take_out_their_cells_and_those_around_them():
    brick, once, _ = carved(1)
    points = np.random.default_rng(1).uniform(-3, 3, (40, 3))
    left = native.take_out_near(brick, once, points, CELL_M)
    expected = oracle.cells_in(brick, once) - oracle.near(points, CELL_M)
    assert oracle.cells_in(brick, left) == expected
    assert 0 < len(expected) < len(oracle.cells_in(brick, once))


@pytest.mark.parametrize("seed", range(3))
def test_a_share_is_that_of_the_reference(seed: int):
    brick, once, _ = carved(seed)
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 2, (500, 3)).astype(np.float32)
    poses = np.array(
        [make_transform(rotation_z(yaw), rng.uniform(-3, 3, 3)) for yaw in (0.0, 1.0, -2.0)]
        + [make_transform(np.eye(3), [900.0, 0, 0])]
    )
    found = SeenFree.of_bricks(brick, once, CELL_M).shares(points, poses)
    free = oracle.cells_in(brick, once)
    assert found == pytest.approx([oracle.share(points, T, free, CELL_M) for T in poses], abs=0.005)
    assert found[:3].max() > 0.05
    assert found[3] == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_place_is_seen_free_if_the_reference_says_so(seed: int):
    brick, once, _ = carved(seed)
    free = oracle.cells_in(brick, once)
    points = np.random.default_rng(seed).normal(0, 2, (500, 3)).astype(np.float32)
    points[-2:] = [[900.0, 0, 0], [np.nan, 0, 0]]
    T = make_transform(rotation_z(0.7), [0.4, -0.3, 0.2])
    found = SeenFree.of_bricks(brick, once, CELL_M)
    at = transform_points(T, points[:-2])
    expected = [tuple(cell) in free for cell in np.floor(at / CELL_M).astype(int).tolist()]
    assert found.holds(points, T).tolist() == [*expected, False, False]
    assert 10 < sum(expected) < 490
    assert found.holds(points, T).mean() == found.shares(points, T[None])[0]
    assert found.holds(points[:0], T).tolist() == []


def test_the_share_of_no_points_or_no_cells_is_zero():
    brick, once, _ = carved(0)
    free = SeenFree.of_bricks(brick, once, CELL_M)
    assert free.shares(np.zeros((0, 3), np.float32), np.eye(4)[None]).tolist() == [0]
    nothing = SeenFree.of_bricks(brick, np.zeros_like(once), CELL_M)
    assert nothing.shares(np.zeros((1, 3), np.float32), np.eye(4)[None]).tolist() == [0]


@pytest.mark.parametrize(
    ("ranges", "cell_m"), [(np.float32(3e6), 1.0), (np.float32(5), 1e-5), (np.float32(5e8), 1.0)]
)
def test_a_ray_through_too_many_cells_is_refused(ranges, cell_m):
    cells = native.CarvedCells(cell_m)
    with pytest.raises(ValueError, match="too many cells"):
        cells.add(np.zeros((1, 3)), np.float32([[1, 0, 0]]), np.full((1, 1), ranges), 0.0)
