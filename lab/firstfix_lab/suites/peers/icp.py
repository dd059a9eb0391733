"""Open3D's fine registration against the map cloud, for peers whose own answer is coarse."""

from __future__ import annotations

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from firstfix.transform import Matrix

SCAN_VOXEL_M = 0.2
NORMAL_RADIUS_M = 0.8


def cloud_of(points: NDArray[np.float64], voxel_m: float, normal_radius_m: float) -> o3d.geometry.PointCloud:
    """(n, 3) points, thinned, with normals."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(voxel_m)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(normal_radius_m, 30))
    return cloud


class Icp:
    """Point-to-plane ICP in two rounds.

    Args:
        map_points: (m, 3).
        reach_m: of the first round; the second's is a third of it.
    """

    def __init__(self, map_points: NDArray[np.float64], reach_m: float) -> None:
        self._map = cloud_of(map_points, SCAN_VOXEL_M, NORMAL_RADIUS_M)
        self._reach_m = reach_m

    def refine(self, points: NDArray[np.float64], T_map_sensor: Matrix) -> Matrix:
        """(n, 3) points in the sensor frame and where they are about, to where they are."""
        scan = cloud_of(points, SCAN_VOXEL_M, NORMAL_RADIUS_M)
        for reach_m in (self._reach_m, self._reach_m / 3):
            T_map_sensor = self._round(scan, T_map_sensor, reach_m)
        return T_map_sensor

    def _round(self, scan: o3d.geometry.PointCloud, T_map_sensor: Matrix, reach_m: float) -> Matrix:
        plane = o3d.pipelines.registration.TransformationEstimationPointToPlane()
        found = o3d.pipelines.registration.registration_icp(scan, self._map, reach_m, T_map_sensor, plane)
        return found.transformation


class Gicp(Icp):
    """Generalized ICP (Segal et al. 2009) in the same two rounds."""

    def _round(self, scan: o3d.geometry.PointCloud, T_map_sensor: Matrix, reach_m: float) -> Matrix:
        found = o3d.pipelines.registration.registration_generalized_icp(
            scan, self._map, reach_m, T_map_sensor
        )
        return found.transformation
