"""Chooses the spacing of the templates from the size of the place, unless the config sets it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.sensor import SensorModel

from ..simulation.simulate import Simulator
from ..viewpoints.sample import DEFAULT_SPACING_M, Viewpoints, sample_viewpoints
from .make import view_distance_m

ROOM_SPACING_M = 0.5
ROOM_VIEW_M = 12.0  # where one sees less far, a metre aside is another view: half the metre doubles the finds


def sample_fitting_viewpoints(
    simulator: Simulator,
    config: ViewpointConfig,
    sensor: SensorModel,
    trajectory: NDArray[np.float64] | None,
) -> tuple[Viewpoints, float]:
    """Viewpoints, and the spacing in metres that they were sampled with.

    Raises:
        BuildFailed: there is no floor to stand on.
    """

    def sample(spacing_m: float) -> tuple[Viewpoints, float]:
        chosen = config.model_copy(update={"spacing_m": spacing_m})
        return sample_viewpoints(simulator, chosen, sensor.mount_height_m, trajectory), spacing_m

    if config.spacing_m is not None:
        return sample(config.spacing_m)
    found, spacing_m = sample(DEFAULT_SPACING_M)
    if view_distance_m(simulator, found.positions, sensor) < ROOM_VIEW_M:
        return sample(ROOM_SPACING_M)
    return found, spacing_m
