"""Sighting: which cells of the map one localized scan confirms, sees through, or cannot explain.

A mapped point has left if all rays in and around its direction end well beyond it; it is confirmed if one of
them ends there. A return is not explained if nothing is mapped near it, though the map covers the place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...scan.compact import CompactScan
from ...scan.range_view import RangeView, directions
from ...scan.scan import Scan
from ...scan.sequence import ScanSequence
from ...scan.voxel_filter import TimedPoints
from ...transform import Matrix, inverse
from ..index import MapIndex
from ..motion.deskewed import deskewed
from ..registration.align import MapSurface
from ..registration.surface_grid import SurfaceGrid
from ..retrieval.tile_table import runs_around
from ..verification.free_space import MapView
from ..verification.point_tiles import PointTiles
from .block import REACH_M, Block
from .cells import Spot, spot_of
from .range_image import RangeImage

TOLERANCE_M, TOLERANCE = 0.2, 0.02  # along a ray, for the errors of map, pose and range
NEAR_M = 1.5  # nearer than this, an error of the pose is wider than the directions around a point
FINE_M = 5.0  # from here on three directions of 1 degree are wide enough, before that of 2
FINE_DEG, COARSE_DEG = 1.0, 2.0
FEWEST = 2  # points or returns of a cell that must agree: one alone may be a stray
GONE_SHARE = 0.3  # of the mapped points of a cell that show: its floor stays where a rack has left
NEW_SHARE = 0.03  # of the rays at a cell: most of them pass through a shelf, or beside it
_FINE_POINTS_M = 9.0  # up to which the fine points are compared, as in the free-space check
_EXPLAINED_M = 0.2  # and up to twice the cell of the surface's grid more
_RETURNS = 20_000


@dataclass(frozen=True)
class Sighting:
    """Cells that one scan shows, each at most once for each attribute, as keys in ascending order.

    Attributes:
        spot: where it was taken.
        confirmed: (a,) cells whose mapped surface the scan met.
        contradicted: (b,) cells of which it saw through a part of the mapped surface.
        unexplained: (c,) cells with returns that the map does not explain.
        free: (d,) cells that it saw through, without such returns.
    """

    spot: Spot
    confirmed: NDArray[np.int64]
    contradicted: NDArray[np.int64]
    unexplained: NDArray[np.int64]
    free: NDArray[np.int64]


def sighting_of(
    index: MapIndex, scan: Scan | CompactScan, T_map_sensor: Matrix, twist: NDArray[np.float64] | None = None
) -> Sighting:
    """The sighting of a scan that was localized.

    Args:
        T_map_sensor: (4, 4) its pose in the map's own frame.
        twist: (6,) motion of the sensor during the scan, if it was solved or given.
    """
    timed = scan if twist is None or scan.time_s is None else _at_stamp(scan, twist)
    returns, fine_deg = _returns_of(timed, index)
    T_level_sensor = inverse(index.T_map_level) @ T_map_sensor
    mapped = points_around(index.view, T_level_sensor)
    gone, met = compared(mapped, returns, fine_deg)
    new = unexplained(returns, mapped, index.surface, T_level_sensor)
    return _by_cells(Block.around(T_map_sensor), mapped, gone, met, returns, new)


def points_around(view: MapView, T_level_sensor: Matrix) -> NDArray[np.float32]:
    """(n, 3) mapped points within reach of a sensor, in its frame: near it the fine ones."""
    reach_m = min(view.reach_m, REACH_M)
    fine_m = min(_FINE_POINTS_M, reach_m)
    near = _within(view.near, T_level_sensor, 0.0, fine_m)
    return np.concatenate([near, _within(view.far, T_level_sensor, fine_m, reach_m)])


def compared(
    mapped: NDArray[np.float32], returns: NDArray[np.float32], fine_deg: float = FINE_DEG
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns for each of (n, 3) mapped points whether a scan sees through it, and whether it meets it.

    Where something stands in front of a point, or nothing returned around it, both are False.

    Args:
        mapped, returns: in the sensor frame.
        fine_deg: width of the directions that are compared from FINE_M on.
    """
    gone, met = np.zeros((2, len(mapped)), bool)
    range_m = np.linalg.norm(mapped, axis=1)
    for step_deg, rows in (
        (COARSE_DEG, np.flatnonzero((range_m >= NEAR_M) & (range_m < FINE_M))),
        (fine_deg, np.flatnonzero(range_m >= FINE_M)),
    ):
        image = RangeImage.of(returns, step_deg)
        at, here_m = image.at(mapped[rows]), range_m[rows]
        slack_m = here_m * TOLERANCE + TOLERANCE_M
        seen_m = [each.ravel()[at] for each in (image.nearest_m, image.least_m, image.most_m)]
        gone[rows] = image.covered.ravel()[at] & (seen_m[1] > here_m + slack_m)
        met[rows] = np.any([np.abs(each - here_m) <= slack_m for each in seen_m], axis=0)
    return gone, met


def unexplained(
    returns: NDArray[np.float32],
    mapped: NDArray[np.float32],
    surface: MapSurface,
    T_level_sensor: Matrix,
) -> NDArray[np.bool_]:
    """Returns for each of (n, 3) returns whether nothing is mapped near it, though the map covers the place.

    It does if something is mapped behind the return. Where nothing is mapped in its direction within reach,
    it does if something is mapped below: a floor, or open ground.

    Args:
        returns, mapped: in the sensor frame.
        surface: of the same map.
    """
    range_m = np.linalg.norm(returns, axis=1)
    behind = RangeImage.of(mapped, COARSE_DEG)
    at = behind.at(returns)
    mapped_m = behind.nearest_m.ravel()[at]
    # where a direction passes between two points of a wall, those around it tell what is mapped
    is_known = np.isfinite(mapped_m) | np.isinf(behind.least_m.ravel()[at])
    rows = np.flatnonzero((range_m < REACH_M) & (mapped_m > range_m) & is_known)
    where = returns[rows] @ T_level_sensor[:3, :3].T.astype(np.float32)
    where += T_level_sensor[:3, 3].astype(np.float32)
    for offset in _OFFSETS_M:
        kept = ~_has_surface(surface.fine, where + offset)
        rows, where = rows[kept], where[kept]
    is_covered = np.isfinite(mapped_m[rows])
    for below in _BELOW_M:
        is_covered |= _has_surface(surface.coarse, where + below)
    rows = rows[is_covered]
    strange = np.zeros(len(returns), bool)
    strange[rows] = True
    return strange


def _by_cells(
    block: Block,
    mapped: NDArray[np.float32],
    gone: NDArray[np.bool_],
    met: NDArray[np.bool_],
    returns: NDArray[np.float32],
    new: NDArray[np.bool_],
) -> Sighting:
    through, confirmed, ends = (block.count(part) for part in (mapped[gone], mapped[met], returns[new]))
    view = RangeView.of(returns)
    until_m = np.minimum(view.least / (1 + TOLERANCE) - TOLERANCE_M, REACH_M - 1)
    passing = block.count_passing(directions()[view.returned], until_m[view.returned])
    is_gone = (through >= FEWEST) & (through >= GONE_SHARE * (through + confirmed))
    return Sighting(
        spot_of(block.T_map_sensor[:3, 3]),
        block.keys((confirmed >= FEWEST) & ~is_gone),
        block.keys(is_gone),
        block.keys((ends >= FEWEST) & (ends >= NEW_SHARE * (ends + passing))),
        block.keys((passing >= FEWEST) & (ends == 0)),
    )


def _has_surface(grid: SurfaceGrid, points: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Returns for each of (n, 3) points of the index's frame whether the grid finds a surface near it."""
    return grid.nearest(np.ascontiguousarray(points - grid.corner, np.float32)) >= 0


def _at_stamp(scan: Scan | CompactScan, twist: NDArray[np.float64]) -> Scan | CompactScan:
    return deskewed(ScanSequence.single(scan), twist).scans[-1]


def _returns_of(scan: Scan | CompactScan, index: MapIndex) -> tuple[NDArray[np.float32], float]:
    """(n, 3) returns in the sensor frame, and the width of the directions that they can be told apart by."""
    config = index.config.preprocess
    if isinstance(scan, CompactScan):  # a range in each direction of 2 degrees
        seen = (scan.nearest_m > config.min_range_m) & (scan.nearest_m < config.max_range_m)
        return directions()[seen] * scan.nearest_m[seen, None], COARSE_DEG
    timed = TimedPoints(scan.points, None).within_range(config.min_range_m, config.max_range_m)
    return timed.at_most(_RETURNS).points.astype(np.float32), FINE_DEG


def _within(tiles: PointTiles, T_level_sensor: Matrix, low_m: float, high_m: float) -> NDArray[np.float32]:
    centre = T_level_sensor[:3, 3]
    parts = [tiles.points[rows] for rows in runs_around(tiles.begin, tiles.low, centre, high_m)]
    away = np.concatenate([np.empty((0, 3), np.float32), *parts]) - centre.astype(np.float32)
    range_m = np.linalg.norm(away, axis=1)
    kept: NDArray[np.float32] = away[(range_m >= low_m) & (range_m < high_m)]
    return kept @ T_level_sensor[:3, :3].astype(np.float32)


def _ball() -> NDArray[np.float32]:
    """Places (n, 3) to look at around a return: itself, then half-way and all the way to the neighbours."""
    around = np.array([offset for offset in np.ndindex(3, 3, 3) if offset != (1, 1, 1)], np.float64) - 1
    unit = around / np.linalg.norm(around, axis=1, keepdims=True)
    return np.concatenate([np.zeros((1, 3)), unit / 2, unit]).astype(np.float32)


# A coarse cell finds a floor half a metre below: to four metres down.
_BELOW_M = [np.array([0.0, 0.0, -0.5 * step], np.float32) for step in range(1, 8)]
_OFFSETS_M = _ball() * np.float32(_EXPLAINED_M)
