"""A session with its own index, for the alignment of sessions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.localizer import Localizer
from firstfix.engine.registration.surface import Surface
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, inverse

from ...simulation.simulate import Simulator

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
        """For each of (n, 3) points of the surface whether it belongs to a movable object.

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


@dataclass(frozen=True)
class SessionMap:
    """A session with an index of its own. Everything is in the session's levelled frame, metres.

    Attributes:
        name: of the session, for messages.
        simulator: its reconstructed mesh.
        sensor: sensor model of the simulated scans.
        position_m: (v, 3) viewpoints of the sensor.
        height_m: (v,) of these over the floor.
        surface: surface that is seen from there, thinned, with normals that point to the sensor.
        localizer: over its index.
    """

    name: str
    simulator: Simulator
    sensor: SensorModel
    position_m: NDArray[np.float64]
    height_m: NDArray[np.float64]
    surface: Surface
    localizer: Localizer

    @classmethod
    def of(
        cls,
        name: str,
        simulator: Simulator,
        sensor: SensorModel,
        points: NDArray[np.float32],
        found: Localizer,
    ) -> SessionMap:
        """Take the parts of an index that the alignment needs.

        Args:
            points: (n, 3) of the index's surface.
        """
        index = found.index
        fine = index.surface.fine
        surface = Surface(
            np.ascontiguousarray(points, np.float32),
            np.ascontiguousarray(fine.planes[:, :3]),
            np.asarray(fine.oriented, np.bool_),
        )
        templates = index.cascade.templates
        position_m = np.asarray(templates.position_m, np.float64)
        height_m = np.asarray(templates.height_m, np.float64)
        return cls(name, simulator, sensor, position_m, height_m, surface, found)

    @cached_property
    def movable_objects(self) -> MovableObjects:
        """Classifier of movable objects and tall surfaces."""
        return MovableObjects(self.surface)

    @property
    def T_level_map(self) -> Matrix:
        """(4, 4) from the frame of the answers to the levelled frame."""
        return inverse(self.localizer.index.T_map_level)


@dataclass(frozen=True)
class PlacedSession:
    """A session and its transform to the first one.

    Attributes:
        T_first_session: (4, 4) from its levelled frame to that of the first session.
    """

    session: SessionMap
    T_first_session: Matrix
