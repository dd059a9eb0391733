"""Surface: points with normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import small_gicp
from numpy.typing import NDArray

from ...portable.sample import rows_by_chance
from ...transform import Matrix
from .slabs import slabs

_NEIGHBOURS = 10
_GRAZING = 0.1  # sine: a surface seen at a lower angle may be seen from either side


@dataclass(frozen=True)
class Surface:
    """Points with normals.

    Attributes:
        points: (n, 3) float32 metres.
        normals: (n, 3) float32, unit.
        oriented: (n,) whether the normal is known to point towards the viewer. A wall has two faces, and a
            scan of one must not be aligned with the other.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    oriented: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def around(
        cls, points: NDArray[np.floating], to_viewer: NDArray[np.floating] | None = None, threads: int = 1
    ) -> Surface:
        """Surface of points, with normals estimated from each point's neighbours.

        Args:
            points: (n, 3) metres.
            to_viewer: (n, 3) directions of any length, 0 if unknown.
            threads: number to use.
        """
        cloud = small_gicp.PointCloud(np.asarray(points, np.float64))
        tree = small_gicp.KdTree(cloud, num_threads=threads)
        small_gicp.estimate_normals_covariances(cloud, tree, _NEIGHBOURS, num_threads=threads)
        normals = cloud.normals()[:, :3].astype(np.float32)
        if to_viewer is None:
            return cls(np.asarray(points, np.float32), normals, np.zeros(len(points), np.bool_))
        along = np.einsum("ij,ij->i", normals, to_viewer)
        oriented = np.abs(along) > _GRAZING * np.linalg.norm(to_viewer, axis=1)
        normals[along < 0] *= -1
        return cls(np.asarray(points, np.float32), normals, oriented)

    def at(self, rows: NDArray[np.integer] | slice) -> Surface:
        """Surface of the given rows."""
        return Surface(self.points[rows], self.normals[rows], self.oriented[rows])

    def at_most(self, count: int) -> Surface:
        """Surface of at most ``count`` of the points (``rows_by_chance``)."""
        return self if len(self) <= count else self.at(rows_by_chance(len(self), count))

    def moved(self, T: Matrix) -> Surface:
        """Surface brought from the right frame of T to its left frame."""
        R = T[:3, :3].astype(np.float32)
        return Surface(self.points @ R.T + T[:3, 3].astype(np.float32), self.normals @ R.T, self.oriented)

    def thinned(self, voxel_m: float) -> Surface:
        """Surface of the mean point of every voxel, one for each main direction of its normals."""
        parts = [self.at(rows)._thinned(voxel_m) for rows in slabs(self.points, voxel_m)]
        return parts[0] if len(parts) == 1 else Surface.together(parts)

    def _thinned(self, voxel_m: float) -> Surface:
        axis = np.abs(self.normals).argmax(axis=1)
        most = self.normals[np.arange(len(self)), axis]
        negative = (most < 0) & self.oriented
        cell = np.floor(self.points / voxel_m).astype(np.int64)
        cell -= cell.min(axis=0)
        size = cell.max(axis=0) + 1
        way = 3 * (2 * negative + ~self.oriented) + axis
        key = ((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]) * 9 + way
        _, first, group, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
        turn = np.where((most < 0) & ~self.oriented, -1, 1)[:, None]

        def mean(values: NDArray[np.floating]) -> NDArray[np.float32]:
            sums = [np.bincount(group, weights=values[:, axis]) for axis in range(3)]
            return (np.stack(sums, axis=1) / count[:, None]).astype(np.float32)

        normals = mean(self.normals * turn)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.float32(1e-6))
        return Surface(mean(self.points), normals, self.oriented[first])

    @classmethod
    def together(cls, parts: Sequence[Surface]) -> Surface:
        """Surface of all points of several surfaces."""
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.oriented for part in parts]),
        )
