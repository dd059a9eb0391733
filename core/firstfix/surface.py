"""Surfaces as points with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from numpy.typing import NDArray

_NEIGHBOURS = 10


@dataclass(frozen=True)
class Surface:
    """Attributes:
    points: (n, 3) float32 metres.
    normals: (n, 3) float32, unit, of either sign.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def around(cls, points: NDArray[np.floating], threads: int = 1) -> Surface:
        """With the normals of each point's neighbourhood."""
        cloud = small_gicp.PointCloud(np.asarray(points, np.float64))
        tree = small_gicp.KdTree(cloud, num_threads=threads)
        small_gicp.estimate_normals_covariances(cloud, tree, _NEIGHBOURS, num_threads=threads)
        return cls(np.asarray(points, np.float32), cloud.normals()[:, :3].astype(np.float32))

    def at_most(self, count: int) -> Surface:
        """An even part, where the points are in spatial order."""
        every = -(-len(self) // count)
        return Surface(self.points[::every], self.normals[::every])
