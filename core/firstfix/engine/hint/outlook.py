"""Outlook: what a sensor would see of the map from a pose, and how well a scan of one place fits another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...scan.reduction import COLUMNS, ROWS, RangeView, directions, filled_around, least_of_neighbours
from ...transform import Matrix
from ..index import MapView

FAR_M = 1000.0  # where nothing is mapped
NEAR_M = 9.0  # up to which the fine points are drawn, as in the free-space check
BLIND_DEG = 120.0  # a sensor that does not see all round has a wider gap
_BLOB = 6  # of a direction and its eight neighbours
MIN_COMPARED = 20  # directions in which there is something to compare
_ROW_RETURNS = 4  # of a row that the sensor sees; fewer are strays
_TOLERANCE_M, _TOLERANCE = 0.3, 0.03  # as in the free-space check
_THROUGH_WEIGHT, _MAX_THROUGH = 2.0, 0.2  # beside the weight of every misfit
_LEVEL_SIN = np.sin(np.radians(45.0))
_ALL_ROUND = 0.75  # of the columns


@dataclass(frozen=True)
class FieldOfView:
    """Directions in which a sensor sees, in its own frame.

    Attributes:
        cells: (cells,) of a range view.
    """

    cells: NDArray[np.bool_]

    @classmethod
    def of(cls, view: RangeView) -> FieldOfView:
        """Rows and columns of a scan's range view in which there are returns."""
        image = view.returned.reshape(ROWS, COLUMNS)
        rows, columns = image.sum(axis=1) >= _ROW_RETURNS, np.asarray(image.any(axis=0))
        if columns.mean() >= _ALL_ROUND:
            columns[:] = True  # where a spinning sensor has no return there is nothing in reach
        return cls((rows[:, None] & columns).ravel())

    def is_all_round(self, up: NDArray[np.float64]) -> bool:
        """Whether turning about the vertical, (3,) in the sensor frame, shows nothing new."""
        along = directions()[self.cells]
        level = along[np.abs(along @ up) < _LEVEL_SIN]
        if not len(level):
            return True
        ahead = np.eye(3)[np.argmin(np.abs(up))]
        left = np.cross(up, ahead)
        left /= np.linalg.norm(left)
        heading = np.sort(np.arctan2(level @ left, level @ np.cross(left, up)))
        gaps = np.diff(heading, append=heading[0] + 2 * np.pi)
        return bool(gaps.max() <= np.radians(BLIND_DEG))


@dataclass(frozen=True)
class Outlook:
    """Map as it is seen from a pose.

    Attributes:
        nearest: (cells,) float32 metres to the nearest surface in each direction, FAR_M where there is none.
        surface_m: (cells,) the least of these in and around each direction. The map's points are sparse: one
            direction may pass between two points of a wall.
        slack_m: (cells,) by how much it changes from one direction to the next. Along a wall or at an edge a
            small error of the pose changes it as much.
    """

    nearest: NDArray[np.float32]
    surface_m: NDArray[np.float32]
    slack_m: NDArray[np.float32]

    @classmethod
    def at(cls, view: MapView, T_level_sensor: Matrix) -> Outlook:
        """Outlook from a pose in the index's frame."""
        nearest = np.minimum(
            view.near.tables.nearest_by_direction(T_level_sensor, min(NEAR_M, view.reach_m)),
            view.far.tables.nearest_by_direction(T_level_sensor, view.reach_m),
        )
        nearest = np.minimum(nearest, np.float32(FAR_M))
        surface_m = least_of_neighbours(nearest.reshape(ROWS, COLUMNS))
        slack_m = -least_of_neighbours(-surface_m) - least_of_neighbours(surface_m)
        return cls(nearest, surface_m.ravel(), slack_m.ravel())

    def misfit(self, there: Outlook, seen: FieldOfView) -> float:
        """Share of directions in which a scan that is taken here does not fit another place.

        Directions in which it would see through surfaces there count three times, up to a limit: they tell
        places apart best (docs/concepts/hints-and-changes.md).

        Returns:
            0..1; 0 if there is too little to compare.
        """
        rows = seen.cells & (self.surface_m < FAR_M)
        count = int(rows.sum())
        if count < MIN_COMPARED:
            return 0.0
        here_m, there_m = self.surface_m, there.surface_m
        allowed_m = _TOLERANCE_M + _TOLERANCE * here_m + np.maximum(self.slack_m, there.slack_m)
        is_missing = _blobs(rows & (np.abs(here_m - there_m) > allowed_m))
        is_through = is_missing & (here_m > there_m)
        through = min(is_through.sum() / count, _MAX_THROUGH)
        return min(float(is_missing.sum() / count + _THROUGH_WEIGHT * through), 1.0)


def _blobs(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Directions (cells,) that lie among other such ones. The edge of a thing is a line of single cells."""
    return (filled_around(cells.reshape(ROWS, COLUMNS)) >= _BLOB).ravel()
