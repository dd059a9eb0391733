"""Floors under a trajectory: level layers of the map around some of its poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance

from .columns import Columns, Layers

REACH_M = 12.0  # below and above a pose: of one that leans, the floor may be above it
OVER_M, BELOW_M = 0.3, 5.0  # a floor may be so much above the poses of a base, and below those of a sensor
_SAMPLED_POSES = 300
_THICK, _APART = 4, 3  # bins: a floor's noise, and its slope over a column


@dataclass(frozen=True)
class FloorsUnder:
    """Level layers around poses.

    Attributes:
        at: (m, 3) positions of some poses, in the frame of the map's points.
        columns: around each.
        poses: number of all poses.
    """

    at: NDArray[np.float64]
    columns: Columns
    poses: int

    @classmethod
    def of(cls, points: NDArray[np.float64], poses: NDArray[np.float64]) -> FloorsUnder:
        """Look at the map's (n, 3) points around some of (m, 4, 4) poses."""
        at = poses[rows_by_chance(len(poses), _SAMPLED_POSES), :3, 3]
        return cls(at, Columns.at(points, at, -REACH_M, REACH_M), len(poses))

    @cached_property
    def layers(self) -> Layers:
        """All level layers near the poses."""
        return self.columns.layers(_THICK, _APART)

    @cached_property
    def height_m(self) -> NDArray[np.float64]:
        """Height (m,) of each pose over the floor; NaN: there is no floor below it."""
        low = self.layers.where((self.layers.height_m < OVER_M) & (self.layers.height_m > -BELOW_M))
        return -low.nearly_most(len(self.at)).highest(len(self.at))
