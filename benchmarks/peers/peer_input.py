"""The part of a data set that every peer gets."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.scan.scan import Scan
from firstfix_builder.read_map import read_map

from ..common.datasets import Dataset


@dataclass(frozen=True)
class PeerInput:
    """Map, scans and parameters for one peer.

    Attributes:
        version: folder of firstfix's version of the map.
        feature_voxel_m: for feature matching.
        near_m: closer points are the carrier's own.
    """

    dataset: Dataset
    version: Path
    feature_voxel_m: float
    near_m: float

    def map_points(self) -> NDArray[np.float64]:
        """(m, 3) in the map frame."""
        data = read_map(self.dataset.map_path)
        assert data.points is not None
        return data.points + data.origin

    def cropped(self, scan: Scan) -> NDArray[np.float64]:
        """(n, 3) points that are neither the carrier's nor beyond the sensor's range."""
        away_m = np.linalg.norm(scan.points, axis=1)
        far_m = BuildConfig.parse(self.dataset.config).sensor_model.max_range_m
        return scan.points[(away_m > self.near_m) & (away_m < far_m)].astype(np.float64)
