"""What of a map a robot can see, and from where.

Where the map is a mesh this is what stands for its cloud. Not points spread over the surface: a modelled
wall has a back and a floor slab an underside, and a scan registered against those settles a wall's
thickness off. Where the map is a cloud it tells which face of a wall each of its points is on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.sensor import SensorModel
from firstfix.surface import Surface

from .clean_cloud import voxel_means
from .simulate import Simulator
from .templates import scan_batch, upright

RAYS = 16_384
VIEWPOINTS = 3000
AT_ONCE = 100
SEEN_WITHIN_M = 0.3  # of a mapped point: the mesh is not the cloud


def map_surface(
    cloud: NDArray[np.floating] | None,
    simulator: Simulator,
    positions: NDArray[np.floating],
    sensor: SensorModel,
    step_m: float,
    voxel_m: float,
) -> Surface:
    """The cloud of a map, or what is seen of a mesh, thinned and turned towards who sees it.

    Args:
        cloud: (n, 3), or None: the map is the simulator's mesh.
        positions: (v, 3) of the templates.
        step_m: between the points that are seen.
    """
    points, to_viewer = visible_points(simulator, positions, sensor, step_m)
    if cloud is None:
        both = voxel_means(np.column_stack([points, to_viewer]), voxel_m)
        return Surface.around(both[:, :3], both[:, 3:])
    thinned = voxel_means(np.asarray(cloud, np.float64), voxel_m)
    away_m, row = cKDTree(points).query(thinned, distance_upper_bound=SEEN_WITHIN_M)
    seen = np.isfinite(away_m)
    toward = np.zeros_like(thinned)
    toward[seen] = to_viewer[row[seen]]
    return Surface.around(thinned, toward)


def visible_points(
    simulator: Simulator, positions: NDArray[np.floating], sensor: SensorModel, step_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(m, 3) points about ``step_m`` apart, from clean scans at up to VIEWPOINTS of (n, 3) positions, and
    (m, 3) the mean direction from each to those who saw it: short where they stood all around."""
    chosen = positions[:: -(-len(positions) // VIEWPOINTS)]
    probe = sensor.coarser(RAYS)
    directions = probe.directions()
    parts = []
    for start in range(0, len(chosen), AT_ONCE):
        here = chosen[start : start + AT_ONCE]
        ranges = np.concatenate(list(simulator.ranges(upright(here), probe)))
        scans = scan_batch(ranges, directions, np.zeros(len(here)))
        to_viewer = -scans.points / np.linalg.norm(scans.points, axis=1, keepdims=True)
        seen = np.column_stack([scans.points + here[scans.scan_of_point], to_viewer])
        parts.append(voxel_means(seen, step_m))
    means = voxel_means(np.concatenate(parts), step_m)
    return means[:, :3], means[:, 3:]
