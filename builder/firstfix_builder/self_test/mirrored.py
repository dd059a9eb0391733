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

from ..simulation.rays import Rays
from ..simulation.simulate import Simulator

_MIRROR = np.diag([1.0, -1.0, 1.0])
_ALIKE_M, _ALIKE_SHARE = 0.1, 0.02  # of ranges: what is nearer is the same surface
_SAME_RAYS = 0.8  # more rays that meet the same: the mirror image is in the map
_COMPARED_RAYS, _LEAST_RAYS = 2000, 100
_LEVEL_M = 0.2  # nearer to the floor or the ceiling, a surface tells no places apart


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
    rays = Rays.of_sensor(sensor).directions
    some = Rays.of(rays[np.random.default_rng(len(rays)).integers(len(rays), size=_COMPARED_RAYS)])
    image = Rays.of(turned(some.directions, _mirror_of(sensor)))
    own = next(simulator.ranges(T_level_sensor[None], sensor, some))[0]
    found = next(simulator.ranges(T_level_found[None], sensor, image))[0]
    height_m = some.turned(T_level_sensor).directions[:, 2] * own
    met = np.isfinite(own)
    if not met.any():
        return False
    floor_m, ceiling_m = np.percentile(height_m[met], [5, 95])  # they are the same in every room
    tells = met & (height_m > floor_m + _LEVEL_M) & (height_m < ceiling_m - _LEVEL_M)
    same = np.abs(own[tells] - found[tells]) < _ALIKE_M + _ALIKE_SHARE * own[tells]
    return len(same) >= _LEAST_RAYS and float(same.mean()) > _SAME_RAYS


def _mirror_of(sensor: SensorModel) -> Matrix:
    """(3, 3) in the sensor's frame."""
    mirror: Matrix = sensor.R_base_sensor.T @ _MIRROR @ sensor.R_base_sensor
    return mirror
