"""Fine pose from a coarse one: the scan against the map cloud (small_gicp).

VGICP against Gaussian voxels first: its basin is a metre wide and a step costs a hash look-up a point.
GICP against the map's own points, ten times as dear, then removes what the voxels' size leaves: with few
points and steps to compare places, with more for the best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .engine_config import RegistrationConfig
from .transform import Matrix, transform_points

_NEIGHBOURS = 10
_MEASURED_SETTLED = 400  # points are enough to tell which candidates settled at all


@dataclass(frozen=True)
class Registration:
    """Where a scan settled.

    Attributes:
        T_level_sensor: (4, 4) in the index's frame.
        overlap: 0..1, share of the scan's points within ``inlier_distance_m`` of the map.
        closeness: 0..1, the same but each point counts less the further off it lies: it tells the
            true minimum from one beside it, where overlap alone does not.
        information: (6, 6) of the fine registration, over rotation then translation, as a
            perturbation on the right of T_level_sensor.
    """

    T_level_sensor: Matrix
    overlap: float
    closeness: float
    information: NDArray[np.float64]


class MapCloud:
    """The map's points, made ready to register against. Thread-safe once built.

    Args:
        points: (m, 3) metres, thinned to about ``map_voxel_m``.
    """

    def __init__(self, points: NDArray[np.floating], config: RegistrationConfig, threads: int = 2) -> None:
        self.config = config
        self._nearest = cKDTree(points)
        self._target = small_gicp.PointCloud(np.asarray(points, np.float64))
        self._target_tree = small_gicp.KdTree(self._target, num_threads=threads)
        small_gicp.estimate_covariances(self._target, self._target_tree, _NEIGHBOURS, num_threads=threads)
        self._voxels = small_gicp.GaussianVoxelMap(config.coarse_voxel_m)
        self._voxels.insert(self._target)

    def settle(self, scan: small_gicp.PointCloud, T_level_sensor: Matrix) -> Registration:
        """Where the voxels lead from a start within a metre or so."""
        result = small_gicp.align(
            self._voxels,
            scan,
            init_T_target_source=T_level_sensor,
            max_iterations=self.config.coarse_iterations,
        )
        return self._measured(scan, result, _MEASURED_SETTLED)

    def compare(self, scan: small_gicp.PointCloud, T_level_sensor: Matrix) -> Registration:
        """From a settled pose near enough to the end to tell places apart."""
        return self._in_points(scan, T_level_sensor, self.config.compare_iterations)

    def refine(self, scan: small_gicp.PointCloud, T_level_sensor: Matrix) -> Registration:
        """From a settled pose to the end."""
        return self._in_points(scan, T_level_sensor, self.config.fine_iterations)

    def _in_points(
        self, scan: small_gicp.PointCloud, T_level_sensor: Matrix, iterations: int
    ) -> Registration:
        result = small_gicp.align(
            self._target,
            scan,
            self._target_tree,
            init_T_target_source=T_level_sensor,
            registration_type="GICP",
            max_correspondence_distance=self.config.fine_distance_m,
            max_iterations=iterations,
        )
        return self._measured(scan, result, scan.size())

    def _measured(
        self, scan: small_gicp.PointCloud, result: small_gicp.RegistrationResult, measured: int
    ) -> Registration:
        T: Matrix = result.T_target_source
        reach = self.config.inlier_distance_m
        points = scan.points()[:: max(1, scan.size() // measured), :3]
        points = transform_points(T, points)
        distance, _ = self._nearest.query(points, distance_upper_bound=reach)
        closeness = np.mean(np.maximum(1 - (distance / reach) ** 2, 0))
        return Registration(T, float(np.mean(distance <= reach)), float(closeness), np.asarray(result.H))
