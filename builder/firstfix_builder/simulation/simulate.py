"""Simulated LiDAR scans: rays against the mesh of the map (paper III.A, with Embree for Gazebo)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import SensorModel

from ..mesh.open3d_core import o3d

RAYS_AT_ONCE = 4_000_000  # 96 MB of rays


class Simulator:
    """Casts a sensor model's rays in a triangle mesh. Thread-safe: Embree scenes are read-only.

    Args:
        vertices: (v, 3) metres, map frame.
        triangles: (t, 3) indices.
        threads: that cast rays for one call; 0: as many as there are processors. The ranges are the same.
    """

    def __init__(
        self, vertices: NDArray[np.floating], triangles: NDArray[np.integer], *, threads: int = 0
    ) -> None:
        self._threads = threads
        self.low: NDArray[np.float64] = np.min(vertices, axis=0).astype(np.float64)  # (3,) bounds, metres
        self.high: NDArray[np.float64] = np.max(vertices, axis=0).astype(np.float64)
        self.scene = o3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(
            o3d.core.Tensor(np.ascontiguousarray(vertices, np.float32)),
            o3d.core.Tensor(np.ascontiguousarray(triangles, np.uint32)),
        )

    def cast(self, origins: NDArray[np.floating], directions: NDArray[np.floating]) -> NDArray[np.float32]:
        """(r, 3) origins and unit directions to (r,) ranges in metres, inf where nothing is hit."""
        rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
        ranges: NDArray[np.float32] = self.scene.cast_rays(o3d.core.Tensor(rays), self._threads)[
            "t_hit"
        ].numpy()
        return ranges

    def surfaces_below(
        self, origins: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns drop and steepness of the surface below each of (r, 3) origins.

        The (r,) drop is inf where there is no surface. The (r,) steepness is |z| of the unit normal: 1 is
        level.
        """
        down = np.broadcast_to(np.array([0, 0, -1], np.float32), origins.shape)
        rays = np.concatenate([origins, down], axis=1).astype(np.float32)
        hit = self.scene.cast_rays(o3d.core.Tensor(rays))
        return hit["t_hit"].numpy(), np.abs(hit["primitive_normals"].numpy()[:, 2])

    def distance(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """(n, 3) points to (n,) distances in metres to the nearest surface."""
        query = o3d.core.Tensor(np.ascontiguousarray(points, np.float32))
        distances: NDArray[np.float32] = self.scene.compute_distance(query).numpy()
        return distances

    def ranges(
        self,
        T_map_sensor: NDArray[np.float64],
        sensor: SensorModel,
        directions: NDArray[np.float32] | None = None,
    ) -> Iterator[NDArray[np.float32]]:
        """Clean ranges at (n, 4, 4) poses, in chunks of (k, rays), inf where there is no return.

        Args:
            directions: (rays, 3) unit rays in the frame of the poses; None: ``sensor.directions()``.
        """
        directions = sensor.directions() if directions is None else directions
        at_once = max(1, RAYS_AT_ONCE // len(directions))
        for start in range(0, len(T_map_sensor), at_once):
            T = T_map_sensor[start : start + at_once]
            world = np.einsum("nij,rj->nri", T[:, :3, :3].astype(np.float32), directions)
            origins = np.broadcast_to(T[:, None, :3, 3].astype(np.float32), world.shape)
            hit = self.cast(origins.reshape(-1, 3), world.reshape(-1, 3)).reshape(len(T), -1)
            hit[(hit < sensor.min_range_m) | (hit > sensor.max_range_m)] = np.inf
            yield hit
