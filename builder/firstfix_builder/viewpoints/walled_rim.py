"""The rim of a floor, and how much of it is a wall: a storey has walls around it, a roof falls away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..simulation.simulate import Simulator
from .floors import ColumnIndex, Grid, Surfaces

WALL_M = 1.5  # above the floor: a parapet, a table and a unit on the roof are lower
_SIDES = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
_BEYOND_CELLS = 2  # behind the room for the body, a wall is met that is not square to the cells


def rim_and_walls(
    simulator: Simulator,
    grid: Grid,
    floors: Surfaces,
    own: NDArray[np.int64],
    *,
    step_m: float,
    max_slope: float,
    radius_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(n,) sides of each of the (n,) own rows with no floor next to them, and of these those with a wall.

    Args:
        floors: sorted, those around the own ones too.
        step_m, max_slope: by which the floor next to one may be higher or lower.
        radius_m: of the body, which keeps floors away from walls.
    """
    index = ColumnIndex(grid, floors)
    eye = np.column_stack([grid.centre_m(floors.column), floors.z + WALL_M])[own]
    rim, walls = np.zeros(len(own), np.int64), np.zeros(len(own), np.int64)
    for side in _SIDES:
        near = index.nearest(floors.column[own] + side, floors.z[own], step_m + max_slope * grid.cell_m)
        ends = np.flatnonzero(near < 0)
        reach_m = np.array([*side, 0.0]) * (radius_m + _BEYOND_CELLS * grid.cell_m)
        rim[ends] += 1
        walls[ends] += ~simulator.is_way_free(eye[ends], eye[ends] + reach_m)
    return rim, walls
