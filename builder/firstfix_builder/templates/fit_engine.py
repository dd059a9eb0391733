"""Chooses the engine's parameters by the density of the map and the view distance in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from firstfix.engine.config import (
    ClusterConfig,
    EngineConfig,
    OccupancyConfig,
    PcaScConfig,
    PreprocessConfig,
    RegistrationConfig,
    SearchConfig,
    VerificationConfig,
)
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix

from ..mesh.places.chance import SPACING_STEPS, VIEW_STEPS, stepped

if TYPE_CHECKING:
    from firstfix.builds.config import EngineOverrides


def fit_engine(
    overrides: EngineOverrides,
    sensor: SensorModel,
    map_spacing_m: float,
    view_m: float,
    spacing_m: float,
    T_map_level: Matrix,
) -> EngineConfig:
    """Engine parameters. Their lengths scale with the map's point spacing and with the view distance.

    Both are rounded to coarse steps: a change of one part of a map usually does not change the parameters, so
    the chunks of the other parts are reused.

    Args:
        map_spacing_m: median distance between neighbouring map points.
        view_m: how far one sees (``view_m.npy`` of ``fitting_viewpoints``).
        spacing_m: between templates.
    """
    map_spacing_m, view_m = stepped(map_spacing_m, SPACING_STEPS), stepped(view_m, VIEW_STEPS)
    voxel_m = round(float(np.clip(1.25 * map_spacing_m, 0.1, 0.3)), 3)
    source_m = round(2.5 * voxel_m, 3)
    paper = overrides.method == "paper"
    described = PcaScConfig if paper else OccupancyConfig
    return EngineConfig(
        descriptor=overrides.descriptor or described(max_range_m=round(float(np.clip(view_m, 10.0, 80.0)))),
        preprocess=overrides.preprocess
        or PreprocessConfig(
            min_range_m=sensor.min_range_m,
            # further out the map is sparse: returns there would count against every place alike
            max_range_m=round(min(sensor.max_range_m, max(30.0, 2.5 * view_m)), 1),
            voxel_m=source_m,
            default_height_m=sensor.mount_height_m,
        ),
        cluster=overrides.cluster or (ClusterConfig() if paper else None),
        search=overrides.search
        or (SearchConfig(engine="lsh_kdtree", clusters=10) if paper else SearchConfig()),
        registration=overrides.registration
        or RegistrationConfig(
            map_voxel_m=voxel_m,
            coarse_voxel_m=round(float(np.clip(5 * voxel_m, 0.4, 1.0)), 3),
            fine_distance_m=round(4.2 * voxel_m, 3),
            inlier_distance_m=round(1.3 * voxel_m, 3),
        ),
        verification=overrides.verification
        or VerificationConfig(reach_m=round(float(np.clip(view_m, 10.0, 30.0)), 1)),
        spacing_m=spacing_m,
        T_map_level=tuple(float(v) for v in T_map_level.ravel()),
    )
