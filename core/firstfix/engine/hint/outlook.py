"""Outlook: what a sensor would see of the map from a pose, and how well a scan of one place fits another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...scan.range_view import COLUMNS, ROWS, RangeView, directions, least_of_neighbours
from ...transform import Matrix
from ..verification.free_space import MapView

NEAR_M = 9.0  # up to which the fine points are drawn, as in the free-space check
BLIND_DEG = 120.0  # a sensor that does not see all round has a wider gap
FEWEST = 20  # directions in which there is something to compare
_ROW_RETURNS = 4  # of a row that the sensor sees; fewer are strays
_TOLERANCE_M, _TOLERANCE = 0.2, 0.03
_BEHIND_M = 0.3
_VIOLATION_WEIGHT, _MAX_VIOLATION = 2.0, 0.2
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
        rows, columns = image.sum(axis=1) >= _ROW_RETURNS, image.any(axis=0)
        if columns.mean() >= _ALL_ROUND:
            columns[:] = True  # where a spinning sensor has no return there is nothing in reach
        return cls((rows[:, None] & columns).ravel())

    def is_all_round(self, up: NDArray[np.float64]) -> bool:
        """Returns whether turning about the vertical, (3,) in the sensor frame, shows nothing new."""
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
        nearest: (cells,) float32 metres to the nearest surface by direction, infinite where there is none.
        least, most: (cells,) the least and the greatest of these in and around each direction. The map's
            points are sparse, so a surface may show in the next direction.
    """

    nearest: NDArray[np.float32]
    least: NDArray[np.float32]
    most: NDArray[np.float32]

    @classmethod
    def at(cls, view: MapView, T_level_sensor: Matrix) -> Outlook:
        """Outlook from a pose in the index's frame."""
        near_m = min(NEAR_M, view.reach_m)
        nearest = np.minimum(
            view.near.tables.nearest_by_direction(T_level_sensor, near_m),
            view.far.tables.nearest_by_direction(T_level_sensor, view.reach_m),
        )
        greatest = np.where(np.isfinite(nearest), -nearest, np.float32(np.inf))
        return cls(nearest, _around(nearest), -_around(greatest))

    def misfit(self, there: Outlook, seen: FieldOfView) -> float:
        """Expected loss of support of a scan that is taken here and compared with another place.

        Surfaces that are not there cost alignment score, and surfaces there that the scan sees through cost
        free space: the two parts of a place's support (docs/method.md section 7).

        Returns:
            0..1; 0 if there is too little to compare.
        """
        rows = np.flatnonzero(seen.cells & np.isfinite(self.nearest))
        if len(rows) < FEWEST:
            return 0.0
        nearest, least, most = self.nearest[rows], there.least[rows], there.most[rows]
        tolerance = _TOLERANCE_M + _TOLERANCE * nearest
        is_missing = (nearest < least - tolerance) | (nearest > most + tolerance)
        mapped = there.nearest[rows]
        is_through = self.least[rows] > mapped * (1 + _TOLERANCE) + _BEHIND_M
        violation = is_through.sum() / max(int(np.isfinite(mapped).sum()), 1)
        return min(float(is_missing.mean() + _VIOLATION_WEIGHT * min(violation, _MAX_VIOLATION)), 1.0)


def _around(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return least_of_neighbours(image.reshape(ROWS, COLUMNS)).ravel()
