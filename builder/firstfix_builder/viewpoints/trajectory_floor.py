"""The floor under a trajectory: the robot drove on it, whatever the mesh looks like there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..simulation.simulate import Simulator
from .floors import ColumnIndex, Grid, Surfaces

MAX_STRIDE_M = 3.0  # poses further apart are not joined by a straight line
MAX_MOUNT_M = 5.0
HEIGHT_TOLERANCE_M = 0.5  # a hand-held scanner goes up and down by this much


@dataclass(frozen=True)
class TrajectoryFloor:
    """The floor that a trajectory passed over.

    Attributes:
        mount_height_m: median height of the trajectory over the floor below it.
        foot: (k, 3) points on the floor under the trajectory, metres, no further apart than a cell.
    """

    mount_height_m: float
    foot: NDArray[np.float64]


def trajectory_floor(
    simulator: Simulator, trajectory: NDArray[np.float64], step_m: float, default_height_m: float
) -> TrajectoryFloor:
    """The floor under a trajectory.

    Args:
        trajectory: (m, 4, 4) T_map_sensor.
        step_m: distance between the feet that come out.
        default_height_m: taken where no pose has a floor below it.
    """
    positions = trajectory[:, :3, 3]
    drop = simulator.drops(positions)
    below = drop[np.isfinite(drop) & (drop < MAX_MOUNT_M)]
    # to the centimetre: a hair's change of some floor leaves the viewpoints of all the others alone
    height_m = round(float(np.median(below)), 2) if len(below) else default_height_m
    foot = _densified(positions, step_m)
    foot[:, 2] -= height_m
    return TrajectoryFloor(height_m, foot)


def _densified(positions: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    length = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    pieces = np.where(length <= MAX_STRIDE_M, np.maximum(1, np.ceil(length / step_m)), 1).astype(np.int64)
    number = np.repeat(np.arange(len(pieces)), pieces)
    first = np.cumsum(pieces) - pieces
    share = (np.arange(len(number)) - first[number]) / pieces[number]
    between = positions[number] + share[:, None] * (positions[number + 1] - positions[number])
    return np.concatenate([between, positions[-1:]])


def with_trajectory_floor(
    grid: Grid, surfaces: Surfaces, foot: NDArray[np.float64]
) -> tuple[Surfaces, NDArray[np.bool_]]:
    """The surfaces, and where the trajectory crosses a hole, floor put in at its height.

    Returns:
        all surfaces, sorted, and (n,) which of them the trajectory passed over.
    """
    column = grid.column_of(foot)
    inside = grid.contains(column)
    column, z = column[inside], foot[inside, 2]
    near = ColumnIndex(grid, surfaces).nearest(column, z, HEIGHT_TOLERANCE_M)
    passed = np.zeros(len(surfaces), bool)
    passed[near[near >= 0]] = True
    hole = near < 0
    # one patch a column and storey, however often the trajectory comes by
    storey = np.round(z[hole] / (2 * HEIGHT_TOLERANCE_M)).astype(np.int64)
    _, first = np.unique(np.column_stack([column[hole], storey]), axis=0, return_index=True)
    count = len(first)
    joined = Surfaces(
        np.concatenate([surfaces.column, column[hole][first]]),
        np.concatenate([surfaces.z, z[hole][first]]),
        np.concatenate([surfaces.level, np.ones(count)]),
        np.concatenate([surfaces.headroom_m, np.full(count, np.inf)]),
    )
    passed = np.concatenate([passed, np.ones(count, bool)])
    order = joined.order()
    return joined.subset(order), passed[order]
