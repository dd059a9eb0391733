"""Sighting: which cells of the map one localized scan confirms, sees through, or cannot explain.

A mapped point has left if all rays in and around its direction end well beyond it; it is confirmed if one of
them ends there. A return is not explained if nothing is mapped near it, though the map covers the place.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...scan.compact import CompactScan
from ...scan.reduction import RangeView, TimedPoints, directions
from ...scan.scan import Scan
from ...transform import Matrix, inverse, transform_points
from .at_stamp import at_stamp
from .block import REACH_M, SIZE, Block
from .cells import CELL_M, Spot, cells_of, keys_of, spot_of

if TYPE_CHECKING:  # who reads tallies needs no index, and no library of its searches
    from ..index import MapIndex

TOLERANCE_M, TOLERANCE = 0.2, 0.02  # along a ray, for the errors of map, pose and range
FINE_COLUMNS, COARSE_COLUMNS = 360, 180  # directions around the sensor; near it the coarse ones are compared
MIN_AGREEING = 2  # points or returns of a cell that must agree: one alone may be a stray
GONE_SHARE = 0.3  # of the mapped points of a cell that show: its floor stays where a rack has left
NEW_SHARE = 0.03  # of the rays at a cell: most of them pass through a shelf, or beside it
FREE_SHARE = 0.2  # of the new returns of a cell: the rays of a mapping run leave gaps in what it saw
FINE_POINTS_M = 9.0  # up to which the fine points are compared, as in the free-space check
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
        unmapped: (e,) of the unexplained cells, those that the mapping run never saw.
        knows_coverage: whether the map knows which space was seen; if not, no cell is unmapped.
    """

    spot: Spot
    confirmed: NDArray[np.int64]
    contradicted: NDArray[np.int64]
    unexplained: NDArray[np.int64]
    free: NDArray[np.int64]
    unmapped: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    knows_coverage: bool = False


@dataclass(frozen=True)
class Comparison:
    """A scan against the map at a pose, point by point, in the sensor frame at the scan's stamp.

    Attributes:
        mapped: (m, 3) float32 mapped points that the scan looks at, metres.
        gone, met: (m,) those that it saw through, and those whose surface it met.
        returns: (n, 3) float32 returns of the scan, metres.
        new: (n,) those that the map does not explain.
        unmapped: (k, 3) of the new returns, those where the mapping run never saw. The others are in space
            that it saw free: near a surface of the map no return is new.
        knows_coverage: whether the map knows which space was seen; if not, no return is unmapped.
    """

    mapped: NDArray[np.float32]
    gone: NDArray[np.bool_]
    met: NDArray[np.bool_]
    returns: NDArray[np.float32]
    new: NDArray[np.bool_]
    unmapped: NDArray[np.float32]
    knows_coverage: bool

    @classmethod
    def of(
        cls,
        index: MapIndex,
        scan: Scan | CompactScan,
        T_map_sensor: Matrix,
        twist: NDArray[np.float64] | None = None,
    ) -> Comparison:
        """Compare a scan that was localized. The arguments are those of ``sighting_of``."""
        timed = scan if twist is None or scan.time_s is None else at_stamp(scan, twist)
        returns, columns = _returns_of(timed, index)
        T_level_sensor = np.ascontiguousarray(inverse(index.T_map_level) @ T_map_sensor, np.float64)
        view, surface = index.view, index.surface
        reach_m = min(view.reach_m, REACH_M)
        mapped, gone, met = native.compare_points(
            view.near.tables,
            view.far.tables,
            min(FINE_POINTS_M, reach_m),
            reach_m,
            T_level_sensor,
            returns,
            columns,
        )
        new = native.unexplained_returns(
            returns,
            mapped,
            surface.fine.tables,
            surface.coarse.tables,
            T_level_sensor,
            _AROUND_M,
            _BELOW_M,
            REACH_M,
        )
        unmapped, seen_free = returns[:0], index.seen_free
        if seen_free is not None:
            found = returns[np.flatnonzero(new)]
            unmapped = found[~seen_free.holds(found, T_level_sensor)]
        return cls(mapped, gone, met, returns, new, unmapped, seen_free is not None)


def sighting_of(
    index: MapIndex, scan: Scan | CompactScan, T_map_sensor: Matrix, twist: NDArray[np.float64] | None = None
) -> Sighting:
    """The sighting of a scan that was localized.

    Args:
        T_map_sensor: (4, 4) its pose in the map's own frame.
        twist: (6,) motion of the sensor during the scan, if it was solved or given.
    """
    return sighting_in(Comparison.of(index, scan, T_map_sensor, twist), T_map_sensor)


def sighting_in(compared: Comparison, T_map_sensor: Matrix) -> Sighting:
    """The sighting of a scan that was compared with the map at this pose."""
    block, returns = Block.around(T_map_sensor), compared.returns
    view = RangeView.of(returns)
    until_m = np.minimum(view.least / (1 + TOLERANCE) - TOLERANCE_M, REACH_M - 1)[view.returned]
    cells, counts = native.cell_counts(
        block.turn,
        block.start,
        SIZE,
        compared.mapped,
        compared.gone,
        compared.met,
        returns,
        compared.new,
        directions()[view.returned],
        until_m.astype(np.float32),
        CELL_M,
    )
    through, confirmed, ends, passing = counts.T
    is_gone = (through >= MIN_AGREEING) & (through >= GONE_SHARE * (through + confirmed))
    keys = block.keys(cells)
    is_unexplained = (ends >= MIN_AGREEING) & (ends >= NEW_SHARE * (ends + passing))
    unexplained = keys[is_unexplained]
    unseen = _at(unexplained, transform_points(T_map_sensor, compared.unmapped))
    return Sighting(
        spot_of(T_map_sensor[:3, 3]),
        keys[(confirmed >= MIN_AGREEING) & ~is_gone],
        keys[is_gone],
        unexplained,
        keys[(passing >= MIN_AGREEING) & (ends == 0)],
        unexplained[unseen > (1 - FREE_SHARE) * ends[is_unexplained]],
        compared.knows_coverage,
    )


def _at(cells: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n,) number of the (m, 3) points in each of (n,) cells, keys in ascending order."""
    if not len(cells):
        return np.empty(0, np.int64)
    keys = keys_of(cells_of(points))
    row = np.minimum(np.searchsorted(cells, keys), len(cells) - 1)
    return np.bincount(row[cells[row] == keys], minlength=len(cells))


def _returns_of(scan: Scan | CompactScan, index: MapIndex) -> tuple[NDArray[np.float32], int]:
    """(n, 3) returns in the sensor frame, and into how many directions around the sensor they part."""
    config = index.config.preprocess
    if isinstance(scan, CompactScan):  # a range in each direction of 2 degrees
        seen = (scan.nearest_m > config.min_range_m) & (scan.nearest_m < config.max_range_m)
        return np.ascontiguousarray(directions()[seen] * scan.nearest_m[seen, None]), COARSE_COLUMNS
    timed = TimedPoints(scan.points, None).within_range(config.min_range_m, config.max_range_m)
    return np.ascontiguousarray(timed.at_most(_RETURNS).points, np.float32), FINE_COLUMNS


def _ball() -> NDArray[np.float32]:
    """Places (n, 3) to look at around a return: itself, then half-way and all the way to the neighbours."""
    around = np.array([offset for offset in np.ndindex(3, 3, 3) if offset != (1, 1, 1)], np.float64) - 1
    unit = around / np.linalg.norm(around, axis=1, keepdims=True)
    return np.concatenate([np.zeros((1, 3)), unit / 2, unit]).astype(np.float32)


# A coarse cell finds a floor half a metre below: to four metres down.
_BELOW_M = np.array([[0.0, 0.0, -0.5 * step] for step in range(1, 8)], np.float32)
_AROUND_M = _ball() * np.float32(_EXPLAINED_M)
