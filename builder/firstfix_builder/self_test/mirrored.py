"""Mirrored scans: cheap, hard negatives of a map.

The mirror image of a place has its walls, corners and furniture, but is nowhere in the map, unless the place
or the map is symmetric. Such a scan passes for the next room or the next aisle as easily as a scan ever does.
"""

from __future__ import annotations

import numpy as np

from firstfix.scan.levelling import turned
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix

from ..simulation.simulate import Simulator
from .equal_places import share_seen_alike

_MIRROR = np.diag([1.0, -1.0, 1.0])
_SAME_RAYS = 0.8  # more rays that meet the same: the mirror image is in the map


def mirrored(scan: Scan, sensor: SensorModel) -> Scan:
    """The scan with the robot's left and right exchanged. Up stays up."""
    return Scan.from_points(turned(scan.points, _mirror_of(sensor)))


def is_in_map(
    simulator: Simulator, sensor: SensorModel, T_level_sensor: Matrix, T_level_found: Matrix
) -> bool:
    """Returns whether the map has the mirror image of a place, at the pose where a mirrored scan was found.

    Args:
        T_level_sensor: (4, 4) of the scan before it was mirrored.
        T_level_found: (4, 4) where its mirror image was found.
    """
    share = share_seen_alike(simulator, sensor, T_level_sensor, T_level_found, _mirror_of(sensor))
    return share > _SAME_RAYS


def _mirror_of(sensor: SensorModel) -> Matrix:
    """(3, 3) in the sensor's frame."""
    mirror: Matrix = sensor.R_base_sensor.T @ _MIRROR @ sensor.R_base_sensor
    return mirror
