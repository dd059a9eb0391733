"""Free-space check in NumPy: the kernels of ``firstfix.native`` are held against it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.index import FreeSpaceShares, MapView
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.engine.retrieval.tile_table import runs_around
from firstfix.engine.verification.point_tiles import PointTiles
from firstfix.scan.levelling import turned
from firstfix.scan.reduction import RangeView, directions, nearest_by_direction
from firstfix.transform import Matrix

NEAR_M = 9.0
TOLERANCE_M, TOLERANCE = 0.3, 0.03  # a return beyond a surface is further by this and this share of its range


def around(tiles: PointTiles, centre: NDArray[np.float64], reach_m: float) -> NDArray[np.float32]:
    """Vectors (k, 3) from a centre, (3,), to every point within reach."""
    columns = [tiles.points[run] for run in runs_around(tiles.begin, tiles.low, centre, reach_m)]
    away = np.concatenate(columns or [tiles.points[:0]]) - centre.astype(np.float32)
    x, y, z = away.T
    near: NDArray[np.float32] = away[x * x + y * y + z * z < np.float32(reach_m**2)]
    return near


def seen_through(
    view: MapView, grid: SurfaceGrid, scan: RangeView, T_level_sensor: Matrix
) -> FreeSpaceShares:
    """Shares of directions in which the scan sees through the map; 1 and 0 if they have none in common."""
    R, centre = T_level_sensor[:3, :3].astype(np.float32), T_level_sensor[:3, 3]
    near = around(view.near, centre, min(NEAR_M, view.reach_m))
    away = np.concatenate([near, around(view.far, centre, view.reach_m)])
    mapped = nearest_by_direction(turned(away, R.T))
    both = np.isfinite(mapped) & scan.returned
    if not both.any():
        return FreeSpaceShares(1.0, 0.0)
    beyond = both & (scan.least > mapped * np.float32(1 + TOLERANCE) + np.float32(TOLERANCE_M))
    returns = directions()[beyond] * scan.least[beyond, None]
    from_corner = turned(returns, R) + (centre - grid.corner).astype(np.float32)
    cells = np.array(grid.group.shape) * grid.block.shape[1] * grid.point.shape[1]
    scaled = from_corner / grid.cell
    inside = ((scaled >= 0) & (scaled < cells)).all(axis=1)
    onto_surface = int((grid.nearest(from_corner[inside]) >= 0).sum())
    return FreeSpaceShares((int(beyond.sum()) - onto_surface) / both.sum(), onto_surface / both.sum())
