"""Samples of points that are even in space, whatever their order and density."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mesh.places.chance import begins_run, chance_of, rank_in_run


def rows_by_place(
    points: NDArray[np.floating], at_most: int, cell_m: float, seed: int = 0
) -> NDArray[np.int64]:
    """Rows, ascending, of points spread evenly over all places. Storeys count as places of their own.

    Space is cut into cubes. One random point is taken from each cube, then a second from each, and so on. In
    the last round chance decides which cubes are served.

    Args:
        points: (n, 3) metres.
        at_most: number of rows wanted; all rows if there are no more.
        cell_m: edge of a cube.
    """
    count = len(points)
    if count <= at_most:
        return np.arange(count)
    order = np.random.default_rng(seed).permutation(count)
    cells = np.unique(cells_of(points, cell_m)[order], axis=0, return_inverse=True)[1].reshape(-1)
    by_cell = np.argsort(cells, kind="stable")  # within a cell: in random order
    starts = np.flatnonzero(np.diff(cells[by_cell], prepend=-1))
    turn = np.empty(count, np.int64)  # of each point: how many of its cell come before it
    turn[by_cell] = np.arange(count) - np.repeat(starts, np.diff(starts, append=count))
    chosen = np.argsort(turn, kind="stable")[:at_most]  # within a turn too
    return np.sort(order[chosen])


def rows_by_hash(points: NDArray[np.floating], at_most: int, cell_m: float) -> NDArray[np.int64]:
    """Ascending rows of (n, 3) points, as ``rows_by_place`` has them, but by a hash of each point's place.

    So a change elsewhere makes few others of them. To choose from parts of a map, and from what was chosen
    again, is to choose from all, where no cube is in two parts.
    """
    if len(points) <= at_most:
        return np.arange(len(points))
    cell = cells_of(points, cell_m)
    chance = chance_of(points, seed=0)
    by_cell = np.lexsort((chance, *cell.T[::-1]))  # within a cell: by chance
    turn = np.empty(len(points), np.int64)  # of each point: how many of its cell come before it
    turn[by_cell] = rank_in_run(cell[by_cell])
    return np.sort(np.lexsort((chance, turn))[:at_most])


def cells_of(points: NDArray[np.floating], cell_m: float) -> NDArray[np.int64]:
    """(n, 3) cube of each of (n, 3) points."""
    return np.floor(np.asarray(points, np.float64) / cell_m).astype(np.int64)


STOREY_GAP_M = 1.0


@dataclass(frozen=True)
class FloorPoints:
    """Places, each of which may stand for others around it.

    Attributes:
        xy_m: (n, 2) of the places.
        z: (n,) their heights.
        low_z, high_z: (n,) lowest and highest place that each stands for.
    """

    xy_m: NDArray[np.float64]
    z: NDArray[np.float64]
    low_z: NDArray[np.float64]
    high_z: NDArray[np.float64]

    @classmethod
    def alone(cls, xy_m: NDArray[np.float64], z: NDArray[np.float64]) -> FloorPoints:
        """Places of which each stands for itself."""
        return cls(xy_m, z, z, z)

    def subset(self, keep: NDArray[np.bool_]) -> FloorPoints:
        """The chosen places."""
        return FloorPoints(self.xy_m[keep], self.z[keep], self.low_z[keep], self.high_z[keep])


def one_per_block(
    points: FloorPoints, side_m: float, part: NDArray[np.integer] | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The block of each of n points, and for each block the point nearest to its centre.

    Blocks are counted from the frame's origin. Places of one block whose heights leave no gap of
    STOREY_GAP_M are on one storey. So the places of several parts may be thinned part by part, and what is
    left of them together, with the result of thinning all at once.

    Args:
        part: (n,) places of different parts have different blocks; None: there are no parts.

    Returns:
        (n,) block and storey of each point, and (blocks,) row of the point that stands for each.
    """
    xy_m, z = points.xy_m, points.z
    block = np.floor(xy_m / side_m).astype(np.int64)
    place = np.column_stack([np.zeros(len(z), np.int64) if part is None else part, block])
    order = np.lexsort((points.low_z, place[:, 2], place[:, 1], place[:, 0]))
    new_place = begins_run(place[order])
    below = points.high_z[order[_highest_so_far(points.high_z[order], np.cumsum(new_place))]]
    new_storey = np.append(True, points.low_z[order][1:] - below[:-1] > STOREY_GAP_M)[: len(z)]
    group = np.zeros(len(z), np.int64)
    group[order] = np.cumsum(new_place | new_storey) - 1
    off_centre = np.linalg.norm(xy_m - (block + 0.5) * side_m, axis=1).round(6)
    best = np.lexsort((z, xy_m[:, 1], xy_m[:, 0], off_centre, group))
    return group, best[np.append(True, np.diff(group[best]) != 0)[: len(z)]]


def _highest_so_far(z: NDArray[np.float64], place: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) row of the highest of (n,) heights up to each row, within its place; places ascend."""
    rank = np.empty(len(z), np.int64)
    by_height = np.argsort(z, kind="stable")
    rank[by_height] = np.arange(len(z))
    highest: NDArray[np.int64] = by_height[np.maximum.accumulate(place * len(z) + rank) - place * len(z)]
    return highest
