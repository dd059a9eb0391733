"""The floors that a robot can drive on: with room for its body, and connected to their neighbours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..execution.local_executor import in_turn
from ..simulation.simulate import Simulator
from .floors import ColumnIndex, Grid, Surfaces

AT_ONCE = 65_536  # bodies or ways that a thread looks at
DIRECTIONS = np.array([[1, 0], [0, 1], [1, 1], [1, -1]])  # and back


def has_room(
    simulator: Simulator,
    feet: NDArray[np.float64],
    radius_m: float,
    step_m: float,
    height_m: float,
) -> NDArray[np.bool_]:
    """(n,) whether a body stands free on each of (n, 3) feet.

    The body is a stack of balls from step_m, which it can climb, to height_m.
    """
    lowest = step_m + radius_m
    highest = max(lowest, height_m - radius_m)
    balls = np.linspace(lowest, highest, 1 + int(np.ceil((highest - lowest) / (1.5 * radius_m))))
    free = np.ones(len(feet), bool)
    for ball in balls:
        ask = np.flatnonzero(free)
        parts = [ask[start : start + AT_ONCE] for start in range(0, len(ask), AT_ONCE)]

        def is_free(rows: NDArray[np.intp], ball: float = ball) -> NDArray[np.bool_]:
            return simulator.is_free(feet[rows] + [0.0, 0.0, ball], radius_m)

        for rows, found in in_turn(is_free, parts):
            free[rows] = found
    return free


def gap_strides(cell_m: float, bridge_gap_m: float) -> int:
    """How many cells away a floor's neighbour may be."""
    return max(1, int(bridge_gap_m / cell_m + 1))


def passable_pairs(
    simulator: Simulator,
    grid: Grid,
    floors: Surfaces,
    own: NDArray[np.int64],
    *,
    step_m: float,
    max_slope: float,
    bridge_gap_m: float,
    height_m: float,
) -> NDArray[np.int64]:
    """(k, 2) rows of floors that a robot gets from one to the other, from each of the (n,) own rows.

    Neighbouring columns are joined when the way up or down is within a step plus the slope and nothing
    stands between them. Where no floor is next to one, the next floor within bridge_gap_m in that
    direction counts as the neighbour: reconstructed floors have holes, under the scanner for one.
    """
    feet = np.column_stack([grid.centre_m(floors.column), floors.z])
    found = [np.zeros((0, 2), np.int64)]
    for pair in _neighbours(grid, floors, own, step_m, max_slope, bridge_gap_m):
        found.append(pair[_passable(simulator, feet, pair, step_m, height_m)])
    return np.concatenate(found)


def connected_parts(pairs: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(count,) number of the connected part that each is in, of (k, 2) pairs of them."""
    graph = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    part: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return part


def _neighbours(
    grid: Grid,
    floors: Surfaces,
    own: NDArray[np.int64],
    step_m: float,
    max_slope: float,
    bridge_gap_m: float,
) -> Iterator[NDArray[np.int64]]:
    """(k, 2) pairs of floors from the own ones, direction by direction."""
    index = ColumnIndex(grid, floors)
    for direction in DIRECTIONS:
        for sign in (1, -1):
            stride_m = grid.cell_m * float(np.linalg.norm(direction))
            searching = own
            for stride in range(1, 1 + gap_strides(stride_m, bridge_gap_m)):
                # over a gap only a step: with the slope added, a table would be in reach of the floor
                limit_m = step_m + max_slope * stride_m if stride == 1 else step_m
                column = floors.column[searching] + sign * stride * direction
                near = index.nearest(column, floors.z[searching], limit_m)
                found = near >= 0
                yield np.column_stack([searching[found], near[found]])
                searching = searching[~found]


def _passable(
    simulator: Simulator,
    feet: NDArray[np.float64],
    pair: NDArray[np.int64],
    step_m: float,
    height_m: float,
) -> NDArray[np.bool_]:
    """(k,) whether straight lines from foot to foot are free, just above a step and at the top."""
    free = np.ones(len(pair), bool)
    for lift_m in (step_m + 0.05, (step_m + height_m) / 2, height_m):
        ask = np.flatnonzero(free)
        parts = [ask[first : first + AT_ONCE] for first in range(0, len(ask), AT_ONCE)]

        def is_free(rows: NDArray[np.intp], lift_m: float = lift_m) -> NDArray[np.bool_]:
            starts, ends = (feet[pair[rows, end]] + [0.0, 0.0, lift_m] for end in (0, 1))
            return simulator.is_way_free(starts, ends)

        for rows, found in in_turn(is_free, parts):
            free[rows] = found
    return free
