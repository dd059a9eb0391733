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

from ..simulation.simulate import Simulator
from .movable_objects import MovableObjects


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
        """Takes the parts of an index that the alignment needs.

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
