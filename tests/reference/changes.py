"""Comparison of a scan with its map in NumPy: the kernels of ``firstfix.native`` are held against it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.engine.retrieval.tile_table import runs_around
from firstfix.engine.verification.point_tiles import PointTiles
from firstfix.transform import Matrix
from tests.reference.range_image import RangeImage

TOLERANCE_M, TOLERANCE = np.float32(0.2), np.float32(0.02)
NEAR_M, FINE_M, COARSE_COLUMNS = 1.5, 5.0, 180


def points_around(
    near: PointTiles, far: PointTiles, T: Matrix, fine_m: float, reach_m: float
) -> NDArray[np.float32]:
    """(n, 3) mapped points within reach of a sensor, in its frame: near it the fine ones."""
    return np.concatenate([_within(near, T, 0.0, fine_m), _within(far, T, fine_m, reach_m)])


def compared(
    mapped: NDArray[np.float32], returns: NDArray[np.float32], columns: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns for each of (n, 3) mapped points whether a scan sees through it, and whether it meets it."""
    gone, met = np.zeros((2, len(mapped)), bool)
    range_m = lengths(mapped)
    for directions, rows in (
        (COARSE_COLUMNS, np.flatnonzero((range_m >= NEAR_M) & (range_m < FINE_M))),
        (columns, np.flatnonzero(range_m >= FINE_M)),
    ):
        image = RangeImage.of(returns, directions)
        at, here_m = image.at(mapped[rows]), range_m[rows]
        slack_m = here_m * TOLERANCE + TOLERANCE_M
        seen_m = [each.ravel()[at] for each in (image.nearest_m, image.least_m, image.most_m)]
        gone[rows] = image.covered.ravel()[at] & (seen_m[1] > here_m + slack_m)
        met[rows] = np.any([np.abs(each - here_m) <= slack_m for each in seen_m], axis=0)
    return gone, met


def unexplained(
    returns: NDArray[np.float32],
    mapped: NDArray[np.float32],
    fine: SurfaceGrid,
    coarse: SurfaceGrid,
    T: Matrix,
    around: NDArray[np.float32],
    below: NDArray[np.float32],
    reach_m: float,
) -> NDArray[np.bool_]:
    """Returns for each of (n, 3) returns whether the map covers its place, and has nothing near it."""
    range_m = lengths(returns)
    behind = RangeImage.of(mapped, COARSE_COLUMNS)
    at = behind.at(returns)
    mapped_m = behind.nearest_m.ravel()[at]
    is_known = np.isfinite(mapped_m) | np.isinf(behind.least_m.ravel()[at])
    rows = np.flatnonzero((range_m < reach_m) & (mapped_m > range_m) & is_known)
    where = turned(returns[rows], T[:3, :3].astype(np.float32)) + T[:3, 3].astype(np.float32)
    for offset in around:
        kept = ~_has_surface(fine, where + offset)
        rows, where = rows[kept], where[kept]
    is_covered = np.isfinite(mapped_m[rows])
    for offset in below:
        is_covered |= _has_surface(coarse, where + offset)
    strange = np.zeros(len(returns), bool)
    strange[rows[is_covered]] = True
    return strange


def count(
    turn: NDArray[np.float32], start: NDArray[np.float32], size: int, points: NDArray[np.float32]
) -> NDArray[np.int64]:
    """Number of (n, 3) points in each of the cells of a cube."""
    at = (turned(points, turn) + start).astype(np.float64)
    cell = np.floor(at[((at >= 0) & (at < size)).all(axis=1)]).astype(np.int64)
    return np.bincount((cell[:, 0] * size + cell[:, 1]) * size + cell[:, 2], minlength=size**3)


def ends_of_steps(
    rays: NDArray[np.float32], until_m: NDArray[np.float32], step_m: float
) -> NDArray[np.float32]:
    """Ends (m, 3) of the whole steps of (n, 3) rays, up to their lengths."""
    steps = np.maximum(until_m / np.float32(step_m), 0).astype(np.int64)
    ray = np.repeat(np.arange(len(steps)), steps)
    number = np.arange(len(ray)) - np.repeat(np.cumsum(steps) - steps, steps)
    at_m = (number + 1).astype(np.float32) * np.float32(step_m)
    return rays[ray] * at_m[:, None]


def turned(points: NDArray[np.float32], R: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turns (n, 3) points by (3, 3), sums from left to right."""
    x, y, z = points.T
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in R], axis=1)


def lengths(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n,) distances from the origin."""
    x, y, z = points.T
    found: NDArray[np.float32] = np.sqrt(x * x + y * y + z * z)
    return found


def _within(tiles: PointTiles, T: Matrix, low_m: float, high_m: float) -> NDArray[np.float32]:
    parts = [tiles.points[rows] for rows in runs_around(tiles.begin, tiles.low, T[:3, 3], high_m)]
    away = np.concatenate([np.empty((0, 3), np.float32), *parts]) - T[:3, 3].astype(np.float32)
    range_m = lengths(away)
    return turned(away[(range_m >= low_m) & (range_m < high_m)], T[:3, :3].T.astype(np.float32))


def _has_surface(grid: SurfaceGrid, points: NDArray[np.float32]) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = grid.nearest(np.ascontiguousarray(points - grid.corner, np.float32)) >= 0
    return found
