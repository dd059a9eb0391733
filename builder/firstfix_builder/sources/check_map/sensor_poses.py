"""Poses of a robot's base, made those of its sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from firstfix.transform import make_transform

from ..read_map.map_data import MapData


def with_sensor_poses(data: MapData, mount_height_m: float) -> MapData:
    """The map with each pose moved up along its own z, as high as the sensor is over the base."""
    if data.trajectory is None or not mount_height_m:
        return data
    T_base_sensor = make_transform(np.eye(3), np.array([0.0, 0.0, mount_height_m]))
    return replace(data, trajectory=data.trajectory @ T_base_sensor)
