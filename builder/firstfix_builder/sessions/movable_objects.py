"""Classifies points as movable objects or as tall surfaces. Storeys may differ only in the former."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.surface import Surface

CELL_M = 0.25
TALL_M = 2.2  # higher upright surfaces are walls, pillars, facades or racks
UPRIGHT_NZ = 0.5
ABOVE_FLOOR_M = (0.2, 2.0)  # heights at which movable objects are searched for


class MovableObjects:
    """Separates movable objects from tall surfaces. Immutable.

    Args:
        surface: of a session, z up.
    """

    def __init__(self, surface: Surface) -> None:
        upright = surface.points[np.abs(surface.normals[:, 2]) < UPRIGHT_NZ].astype(np.float64)
        self._low = upright[:, :2].min(axis=0) - 2 * CELL_M if len(upright) else np.zeros(2)
        cell = self._cell(upright)
        size = cell.max(axis=0, initial=0) + 3
        bottom, top = np.full(size, np.inf), np.full(size, -np.inf)
        np.minimum.at(bottom, tuple(cell.T), upright[:, 2])
        np.maximum.at(top, tuple(cell.T), upright[:, 2])
        tall = top - bottom >= TALL_M
        around = tall.copy()  # and the cells beside it: a hit is not exactly on the surface
        for x in (-1, 0, 1):
            for y in (-1, 0, 1):
                around |= np.roll(tall, (x, y), axis=(0, 1))  # the cells at the edges are empty
        self._tall = around

    def among(self, points: NDArray[np.float64], floor_z: float) -> NDArray[np.bool_]:
        """Returns for each of (n, 3) points of the surface whether it belongs to a movable object.

        Args:
            floor_z: height of the floor at the place from which the points are seen, metres.
        """
        cell = self._cell(points)
        inside = ((cell >= 0) & (cell < self._tall.shape)).all(axis=1)
        tall = np.zeros(len(points), np.bool_)
        tall[inside] = self._tall[tuple(cell[inside].T)]
        above_m = points[:, 2] - floor_z
        found: NDArray[np.bool_] = ~tall & (above_m > ABOVE_FLOOR_M[0]) & (above_m < ABOVE_FLOOR_M[1])
        return found

    def _cell(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.floor((points[:, :2] - self._low) / CELL_M).astype(np.int64)
