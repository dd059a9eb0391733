"""Chooses the spacing of the templates by the view distance, unless the config sets it.

In a room the view changes with every step, so templates stand close together. In the open one template can
represent a whole block, because alignment corrects an offset of more than a metre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.sensor import SensorModel

from ..execution.in_turn import in_turn
from ..simulation.simulate import Simulator
from ..viewpoints.one_per_block import one_per_block
from ..viewpoints.sample import DEFAULT_SPACING_M, Viewpoints, sample_viewpoints
from .outlook import Outlook, room_view_m

ROOM_SPACING_M = 0.5
ROOM_VIEW_M = 12.0  # below this view distance, 0.5 m finds twice as many places as 1 m
OPEN_SPACING_M = 2.0
OPEN_VIEW_M = 20.0  # from this view distance on, 2 m find as many as 1 m (docs/method.md section 1)
AT_ONCE = 256


def sample_fitting_viewpoints(
    simulator: Simulator,
    config: ViewpointConfig,
    sensor: SensorModel,
    trajectory: NDArray[np.float64] | None,
) -> tuple[Viewpoints, float]:
    """Viewpoints, and their largest spacing in metres.

    Raises:
        BuildFailed: there is no floor to stand on.
    """

    def sample(spacing_m: float) -> tuple[Viewpoints, float]:
        chosen = config.model_copy(update={"spacing_m": spacing_m})
        return sample_viewpoints(simulator, chosen, sensor.mount_height_m, trajectory), spacing_m

    if config.spacing_m is not None:
        return sample(config.spacing_m)
    found, spacing_m = sample(DEFAULT_SPACING_M)
    if room_view_m(simulator, found.positions, found.floor_z, sensor) < ROOM_VIEW_M:
        return sample(ROOM_SPACING_M)
    thinned = where_it_tells(simulator, sensor, found)
    return thinned, spacing_m if len(thinned) == len(found) else OPEN_SPACING_M


def where_it_tells(simulator: Simulator, sensor: SensorModel, found: Viewpoints) -> Viewpoints:
    """Removes viewpoints in the open that a neighbour represents, and viewpoints that see only ground.

    The result for a block of OPEN_SPACING_M depends only on the map around it.
    """
    block, standing = one_per_block(found.positions[:, :2], found.floor_z, OPEN_SPACING_M)
    outlook = Outlook.of(sensor)
    places = found.subset(standing)
    parts = [slice(start, start + AT_ONCE) for start in range(0, len(standing), AT_ONCE)]

    def look(rows: slice) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        return outlook.at(simulator, places.positions[rows], places.floor_z[rows])

    looks = [seen for _, seen in in_turn(look, parts)]
    view_m, tells = (np.concatenate(column) for column in zip(*looks, strict=True))
    keep = np.zeros(len(found), np.bool_)
    keep[standing] = True
    keep |= (view_m < OPEN_VIEW_M)[block]
    keep &= tells[block]
    return found.subset(keep) if keep.any() else found
