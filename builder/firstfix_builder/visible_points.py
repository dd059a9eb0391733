"""The points of a mesh that a robot can see: what stands for the map's cloud where the map is a mesh.

Not points spread over the surface: a modelled wall has a back and a floor slab an underside, and a
scan registered against those settles a wall's thickness off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import SensorModel

from .clean_cloud import voxel_means
from .simulate import Simulator
from .templates import scan_batch, upright

RAYS = 16_384
VIEWPOINTS = 3000
AT_ONCE = 100


def visible_points(
    simulator: Simulator, positions: NDArray[np.floating], sensor: SensorModel, step_m: float
) -> NDArray[np.float64]:
    """(m, 3) points about ``step_m`` apart, from clean scans at up to VIEWPOINTS of (n, 3) positions."""
    chosen = positions[:: -(-len(positions) // VIEWPOINTS)]
    probe = sensor.coarser(RAYS)
    directions = probe.directions()
    parts = []
    for start in range(0, len(chosen), AT_ONCE):
        here = chosen[start : start + AT_ONCE]
        ranges = np.concatenate(list(simulator.ranges(upright(here), probe)))
        scans = scan_batch(ranges, directions, np.zeros(len(here)))
        parts.append(voxel_means(scans.points + here[scans.scan_of_point], step_m))
    return voxel_means(np.concatenate(parts), step_m)
