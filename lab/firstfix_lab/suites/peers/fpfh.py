"""FPFH features, RANSAC over their matches, then ICP: Open3D's tutorial on global registration.

Its parameters are the tutorial's (``docs/tutorial/pipelines/global_registration.ipynb``: radii of 2 and 5
voxels, matches within 1.5 voxels, edges alike to 0.9), with ten times its iterations. Its confidence is the
fitness of RANSAC. The tutorial names no threshold, so each answer is accepted.
"""

from __future__ import annotations

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from firstfix.scan.scan import Scan

from .answer import Answer
from .icp import Icp, cloud_of
from .peer_input import PeerInput
from .prior import Prior
from .sent import points_bytes

ITERATIONS, CONFIDENCE = 1_000_000, 0.999
EDGES_ALIKE = 0.9


class Fpfh:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        o3d.utility.random.seed(0)
        self._given, self._voxel_m = given, given.fpfh_voxel_m
        points = given.map_points()
        self._map, self._features = self._described(points)
        self._icp = Icp(points, 1.5 * self._voxel_m)

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        points = self._given.cropped(scan)
        cloud, features = self._described(points)
        registration, reach_m = o3d.pipelines.registration, 1.5 * self._voxel_m
        found = registration.registration_ransac_based_on_feature_matching(
            cloud,
            self._map,
            features,
            self._features,
            True,
            reach_m,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [
                registration.CorrespondenceCheckerBasedOnEdgeLength(EDGES_ALIKE),
                registration.CorrespondenceCheckerBasedOnDistance(reach_m),
            ],
            registration.RANSACConvergenceCriteria(ITERATIONS, CONFIDENCE),
        )
        return Answer(self._icp.refine(points, found.transformation), found.fitness, True)

    def _described(
        self, points: NDArray[np.float64]
    ) -> tuple[o3d.geometry.PointCloud, o3d.pipelines.registration.Feature]:
        cloud = cloud_of(points, self._voxel_m, 2 * self._voxel_m)
        around = o3d.geometry.KDTreeSearchParamHybrid(5 * self._voxel_m, 100)
        return cloud, o3d.pipelines.registration.compute_fpfh_feature(cloud, around)
