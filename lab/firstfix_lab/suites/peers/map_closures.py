"""MapClosures (Gupta et al. 2024, its own C++) over the mapping poses, then ICP.

Its local maps are the map's points round poses of the mapping run, one for each reach of the sensor that
the robot drove, as in its pipeline. A scan is asked as a local map of its own, which its authors make of many
scans. Parameters, and the least number of inliers that is accepted, are the defaults of its
``MapClosuresConfig``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.scan.reduction import voxel_means
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, inverse, transform_points

from .answer import Answer
from .icp import Icp
from .peer_input import PeerInput
from .prior import Prior
from .sent import points_bytes

MAX_RANGE_M = 100.0  # of its pipeline
CANDIDATES = 10
ICP_REACH_M = 1.5
NOT_COMPARED = 4  # numbers this near are one drive's for the package: a query keeps away from the map's


class MapClosuresPeer:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        from map_closures.config import MapClosuresConfig  # not among the project's needs
        from map_closures.map_closures import MapClosures

        config = MapClosuresConfig()
        self._given, self._closures = given, MapClosures(config)
        self._voxel_m, self._least_inliers = config.density_map_resolution, config.inliers_threshold
        points = given.map_points()
        self._T_map_local = self._remember(points)
        self._asked = 0
        self._icp = Icp(points, ICP_REACH_M)

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        points = self._given.cropped(scan)
        known = len(self._T_map_local)
        # A query is remembered, too: the package has no other way to ask.
        self._asked += NOT_COMPARED
        number = known + self._asked
        found = [
            one
            for one in self._closures.get_top_k_closures(number, self._thinned(points), CANDIDATES)
            if one.source_id < known and np.isfinite(one.pose).all()
        ]
        if not found:
            return Answer()
        best: Any = max(found, key=lambda one: one.number_of_inliers)
        T_map_sensor = self._T_map_local[best.source_id] @ inverse(np.asarray(best.pose))
        is_accepted = best.number_of_inliers > self._least_inliers
        return Answer(self._icp.refine(points, T_map_sensor), float(best.number_of_inliers), is_accepted)

    def _remember(self, points: NDArray[np.float64]) -> list[Matrix]:
        sensor = BuildConfig.parse(self._given.dataset.config).sensor_model
        reach_m = min(MAX_RANGE_M, sensor.max_range_m)
        poses: list[Matrix] = []
        for T_map_sensor in self._given.mapping_poses():
            at = T_map_sensor[:3, 3]
            if poses and min(np.linalg.norm(at - T[:3, 3]) for T in poses) < reach_m:
                continue
            near = points[np.linalg.norm(points - at, axis=1) < reach_m]
            self._closures.get_top_k_closures(
                len(poses), self._thinned(transform_points(inverse(T_map_sensor), near)), 1
            )
            poses.append(T_map_sensor)
        return poses

    def _thinned(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return voxel_means(points, self._voxel_m / 5).astype(np.float64)
