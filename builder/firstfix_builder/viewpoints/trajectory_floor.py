"""The floor under a trajectory: the robot drove on it, whatever the mesh looks like there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .floors import ColumnIndex, Grid, Surfaces

MAX_STRIDE_M = 3.0  # poses further apart are not joined by a straight line
MAX_MOUNT_M = 5.0
HEIGHT_TOLERANCE_M = 0.5  # a hand-held scanner goes up and down by this much


@dataclass(frozen=True)
class Track:
    """Points of a trajectory, no further apart than a cell, of which those near a place are found quickly.

    Attributes:
        points: (k, 3) metres.
    """

    points: NDArray[np.float64]

    @classmethod
    def of(cls, positions: NDArray[np.float64], step_m: float) -> Track:
        """Points along (m, 3) positions, step_m apart or less."""
        return cls(_densified(positions, step_m))

    def near(
        self, low: NDArray[np.float64], high: NDArray[np.float64], lowered_m: float
    ) -> NDArray[np.float64]:
        """(n, 3) points over the box of (2,) corners in their order, each lowered."""
        order, x = self._by_x
        rows = np.sort(order[slice(*np.searchsorted(x, [low[0], high[0]]).tolist())])
        y = self.points[rows, 1]
        return self.points[rows[(y >= low[1]) & (y < high[1])]] - [0.0, 0.0, lowered_m]

    @cached_property
    def _by_x(self) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        order = np.argsort(self.points[:, 0], kind="stable")
        return order, self.points[order, 0]


def mount_height_m(drop_m: NDArray[np.float64], default_m: float) -> float:
    """How high a sensor is mounted, from the (m,) drops under its trajectory.

    Args:
        default_m: taken where no pose has a floor below it.
    """
    below = drop_m[np.isfinite(drop_m) & (drop_m < MAX_MOUNT_M)]
    # to the centimetre: a hair's change of some floor leaves the viewpoints of all the others alone
    return round(float(np.median(below)), 2) if len(below) else default_m


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
