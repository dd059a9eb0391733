"""The part of a data set that every peer gets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, from_quaternion, inverse, transform_points
from firstfix_builder.sources.read_map import read_map
from tests.recorded_data import Dataset

MAP_FILE = "map.npy"
MAPPING_STEP_M = 2.0


@dataclass(frozen=True)
class PeerInput:
    """Map, scans and parameters for one peer.

    Attributes:
        work: folder with the map's points; peers may write to it.
        version: folder of firstfix's version of the map.
        paper_version: the same by the method of the paper.
        fpfh_voxel_m, kiss_voxel_m: for feature matching.
        bbs_level_m: edge of the finest voxels of 3D-BBS.
        near_m: closer points are the carrier's own.
        bbs_driver: program that serves 3D-BBS; None: it is not asked.
    """

    dataset: Dataset
    work: Path
    version: Path
    paper_version: Path
    fpfh_voxel_m: float
    kiss_voxel_m: float
    bbs_level_m: float
    near_m: float
    bbs_driver: Path | None = None

    def write_map_points(self) -> None:
        """Read the map's file once for all peers, whose own preparation is timed."""
        data = read_map(self.dataset.map_path)
        assert data.points is not None
        np.save(self.work / MAP_FILE, data.points + data.origin)

    def map_points(self) -> NDArray[np.float64]:
        """(m, 3) in the map frame."""
        return np.load(self.work / MAP_FILE)

    def mapping_poses(self) -> list[Matrix]:
        """T_map_sensor of each pose of the mapping run, in its order."""
        assert self.dataset.trajectory is not None
        rows = self.dataset.trajectory.rows(self.dataset.path)
        poses = [[float(v) for v in pose] for _, pose in rows]
        return [from_quaternion(pose[:3], pose[3:]) for pose in poses]

    def mapping_clouds(self, range_m: float) -> Iterator[tuple[NDArray[np.float64], Matrix]]:
        """Yield (n, 3) points in the sensor frame and T_map_sensor, along the mapping run.

        Without scans of the run: the map's points round its poses, one for every MAPPING_STEP_M.

        Args:
            range_m: of those.
        """
        if self.dataset.mapping_file:
            yield from self.dataset.mapping_scans()
            return
        points, taken = self.map_points(), list[NDArray[np.float64]]()
        for T_map_sensor in self.mapping_poses():
            at = T_map_sensor[:3, 3]
            if taken and np.linalg.norm(at - taken, axis=1).min() < MAPPING_STEP_M:
                continue
            taken.append(at)
            near = points[np.linalg.norm(points - at, axis=1) < range_m]
            yield transform_points(inverse(T_map_sensor), near), T_map_sensor

    def cropped(self, scan: Scan) -> NDArray[np.float64]:
        """(n, 3) points that are neither the carrier's nor beyond the sensor's range."""
        away_m = np.linalg.norm(scan.points, axis=1)
        far_m = BuildConfig.parse(self.dataset.config).sensor_model.max_range_m
        return scan.points[(away_m > self.near_m) & (away_m < far_m)].astype(np.float64)
