"""Simulated LiDAR scans: rays against the mesh of the map (paper III.A)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import LayeredOccupancy
from firstfix.native import TriangleTree
from firstfix.sensor import SensorModel

from .rays import Rays

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

RAYS_AT_ONCE = 1_000_000
MAX_SURFACES = 200  # of one column
_IDENTITY = np.eye(3)


def upright(positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, 3) to (n, 4, 4) poses with no rotation."""
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, 3] = positions
    return T


class Simulator:
    """Casts a sensor model's rays in a triangle mesh. Thread-safe: the mesh is only read.

    Args:
        vertices: (v, 3) metres, map frame.
        triangles: (t, 3) indices.
    """

    def __init__(self, vertices: NDArray[np.floating], triangles: NDArray[np.integer]) -> None:
        self._vertices = np.ascontiguousarray(vertices, np.float32)
        self._triangles = np.ascontiguousarray(triangles, np.uint32)
        self.low: NDArray[np.float64] = np.min(vertices, axis=0).astype(np.float64)  # (3,) bounds, metres
        self.high: NDArray[np.float64] = np.max(vertices, axis=0).astype(np.float64)
        self._tree = TriangleTree(self._vertices, self._triangles)  # for whole scans: rays with one origin

    @cached_property
    def scene(self) -> RaycastingScene:
        """The mesh for single rays and for distances, with as many threads as there are processors."""
        from ..mesh.open3d_core import o3d

        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(o3d.core.Tensor(self._vertices), o3d.core.Tensor(self._triangles))
        return scene

    def cast(self, origins: NDArray[np.floating], directions: NDArray[np.floating]) -> NDArray[np.float32]:
        """(r, 3) origins and unit directions to (r,) ranges in metres, inf where nothing is hit."""
        ranges: NDArray[np.float32] = self.scene.cast_rays(_tensor(origins, directions))["t_hit"].numpy()
        return ranges

    def crossings(
        self, columns: NDArray[np.float64], apart_m: float, most: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float32]]:
        """Surfaces that the vertical lines through (c, 2) places meet, highest first.

        What is less than apart_m below a surface counts as the same one. The height of a surface depends on
        its triangle alone.

        Returns:
            (c + 1,) first surface of each column, (n,) heights in metres, and (n,) steepness: |z| of the unit
            normal, 1 is level.
        """
        start, z, level = self._tree.crossings(np.ascontiguousarray(columns, np.float64), apart_m, most)
        return start, z, level

    def drops(self, origins: NDArray[np.floating]) -> NDArray[np.float64]:
        """(r, 3) origins to the (r,) heights over the surfaces below them, inf where there is none."""
        start, z, _ = self.crossings(origins[:, :2].astype(np.float64), 0.0, MAX_SURFACES)
        drop = np.full(len(origins), np.inf)
        of_origin = np.repeat(np.arange(len(origins)), np.diff(start))
        below = z <= origins[of_origin, 2]
        np.minimum.at(drop, of_origin[below], (origins[of_origin, 2] - z)[below])
        return drop

    def is_way_free(self, starts: NDArray[np.floating], ends: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Whether no surface is met between (n, 3) starts and (n, 3) ends."""
        return self._tree.free_ways(*(np.ascontiguousarray(one, np.float32) for one in (starts, ends))) != 0

    def distance(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """(n, 3) points to (n,) distances in metres to the nearest surface."""
        distances: NDArray[np.float32] = self.scene.compute_distance(_tensor(points)).numpy()
        return distances

    def is_free(self, points: NDArray[np.floating], radius_m: float) -> NDArray[np.bool_]:
        """Whether no surface is within a radius of each of (n, 3) points."""
        return self._tree.near_surface(np.ascontiguousarray(points, np.float32), radius_m) == 0

    def ranges(
        self, T_map_sensor: NDArray[np.float64], sensor: SensorModel, rays: Rays | None = None
    ) -> Iterator[NDArray[np.float32]]:
        """Clean ranges at (n, 4, 4) poses, in chunks of (k, rays), inf where there is no return.

        Poses without a rotation are quickest, and those side by side in turn.

        Args:
            rays: unit rays in the frame of the poses; None: ``Rays.of_sensor(sensor)``.
        """
        rays = Rays.of_sensor(sensor) if rays is None else rays
        at_once = max(1, RAYS_AT_ONCE // len(rays))
        for start in range(0, len(T_map_sensor), at_once):
            T = T_map_sensor[start : start + at_once]
            if (T[:, :3, :3] == _IDENTITY).all():
                yield self._ranges(T[:, :3, 3], rays, sensor)
            else:
                yield np.concatenate([self._ranges(one[None, :3, 3], rays.turned(one), sensor) for one in T])

    def occupied_cells(
        self,
        origins: NDArray[np.floating],
        height_m: NDArray[np.floating],
        sensor: SensorModel,
        rays: Rays,
        descriptor: LayeredOccupancy,
    ) -> NDArray[np.uint8]:
        """(n, bytes) occupancy that a descriptor gives the clean scans of level sensors at (n, 3) origins.

        Args:
            height_m: (n,) of the sensors above their floors.
            rays: unit rays of the sensor at heading zero.
        """
        grid = descriptor.grid
        return self._tree.occupied_cells(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(height_m, np.float32),
            rays.directions,
            rays.order,
            sensor.min_range_m,
            sensor.max_range_m,
            grid.rings,
            grid.sectors,
            grid.max_range_m,
            np.asarray(descriptor.edges_m, np.float32),
        )

    def ranges_beyond(
        self,
        origin: NDArray[np.floating],
        directions: NDArray[np.float32],
        beyond_m: NDArray[np.float32],
        sensor: SensorModel,
    ) -> NDArray[np.float32]:
        """(n,) ranges of (n, 3) unit rays from one origin (3,) to the next surface beyond (n,) ranges."""
        rays = Rays.of(directions)
        return self._tree.ranges_beyond(
            np.ascontiguousarray(origin, np.float32),
            rays.directions,
            rays.order,
            np.ascontiguousarray(beyond_m, np.float32),
            sensor.max_range_m,
        )

    def _ranges(self, origins: NDArray[np.floating], rays: Rays, sensor: SensorModel) -> NDArray[np.float32]:
        """(k, rays) ranges of rays in the map's directions from (k, 3) origins."""
        return self._tree.ranges(
            np.ascontiguousarray(origins, np.float32),
            rays.directions,
            rays.order,
            sensor.min_range_m,
            sensor.max_range_m,
        )


def _tensor(*columns: NDArray[np.floating]):  # type: ignore[no-untyped-def]  # open3d has no types
    from ..mesh.open3d_core import o3d

    return o3d.core.Tensor(np.concatenate(columns, axis=1).astype(np.float32))
