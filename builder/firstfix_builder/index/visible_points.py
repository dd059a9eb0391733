"""The part of a map that a robot can see, with the directions to those who see it.

Where the map is a mesh this is what stands for its cloud. Not points spread over the surface: a modelled
wall has a back and a floor slab an underside, and a scan registered against those settles a wall's
thickness off. Where the map is a cloud it tells which face of a wall each of its points is on.

What is seen is thinned as it comes: in memory is the surface, not the returns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.registration.surface import Surface
from firstfix.native import SeenSurface
from firstfix.sensor import SensorModel

from ..execution.in_turn import in_turn
from ..mesh.clean_cloud import voxel_means
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright
from ..viewpoints.even_sample import cells_of, rows_by_place

RAYS, RAYS_ALL_ROUND = 12_288, 4096
VIEWPOINTS = 3000  # at least, and no fewer than one for each cube of VIEWPOINT_M
VIEWPOINT_M = 3.0
AT_ONCE = 64
BLOCK_M = 200.0
BORDER_M = 1.0  # of the neighbouring blocks, that normals at a border are taken from
SEEN_WITHIN_M = 0.3  # of a mapped point: the mesh is not the cloud


def map_surface(
    cloud: NDArray[np.floating] | None,
    simulator: Simulator,
    positions: NDArray[np.floating],
    sensor: SensorModel,
    step_m: float,
    voxel_m: float,
    *,
    viewpoints: int = VIEWPOINTS,
) -> Surface:
    """The cloud of a map, or what is seen of a mesh, thinned and turned towards who sees it.

    Args:
        cloud: (n, 3), or None: the map is the simulator's mesh.
        positions: (v, 3) of the templates.
        step_m: between the points that are seen.
        viewpoints: see ``visible_points``.
    """
    seen = visible_points(simulator, positions, sensor, step_m, viewpoints)
    if cloud is None:
        thinned = []
        while seen:  # each goes as its successor comes
            thinned.append(voxel_means(seen.pop(0), voxel_m))
        return Surface.together([_with_normals(thinned, number) for number in range(len(thinned))])
    points = np.concatenate(seen)
    thin = voxel_means(np.asarray(cloud, np.float64), voxel_m)
    away_m, row = cKDTree(points[:, :3]).query(thin, distance_upper_bound=SEEN_WITHIN_M, workers=-1)
    known = np.isfinite(away_m)
    toward = np.zeros_like(thin)
    toward[known] = points[row[known], 3:]
    return Surface.around(thin, toward, two_faces=True)


def visible_points(
    simulator: Simulator,
    positions: NDArray[np.floating],
    sensor: SensorModel,
    step_m: float,
    viewpoints: int = VIEWPOINTS,
) -> list[NDArray[np.float64]]:
    """Points on the visible surface, about ``step_m`` apart, as (m, 6) for every block.

    Columns 3 to 5 are the mean direction to the viewpoints that saw a point. It is short where they stood all
    around. Clean scans are cast from some of the (n, 3) positions: most rays go where this sensor looks, the
    rest in all directions, for sensors that look elsewhere.

    Args:
        viewpoints: number of positions to look from, or one for each cube of VIEWPOINT_M, where that is more.
    """
    probe = sensor.coarser(RAYS)
    rays = Rays.of(np.concatenate([Rays.at_any_heading(probe).directions, _all_round(RAYS_ALL_ROUND)]))
    chosen = positions[rows_by_place(positions, max(viewpoints, _occupied(positions)), VIEWPOINT_M)]
    origins = np.ascontiguousarray(chosen, np.float32)
    surface = SeenSurface(step_m)

    def cast(rows: slice) -> NDArray[np.float32]:
        return np.concatenate(list(simulator.ranges(upright(origins[rows]), probe, rays)))

    batches = [slice(start, start + AT_ONCE) for start in range(0, len(origins), AT_ONCE)]
    for rows, ranges in in_turn(cast, batches):
        surface.add(origins[rows], rays.directions, ranges)
    seen = surface.means()
    blocks = _Blocks.over(positions)
    number = blocks.of(seen)
    parts = [seen[number == block] for block in range(blocks.count)]
    return [part for part in parts if len(part)]


def _all_round(count: int) -> NDArray[np.float32]:
    """Unit vectors (count, 3), evenly distributed over the sphere: a Fibonacci lattice."""
    number = np.arange(count) + 0.5
    z, azimuth = 1 - 2 * number / count, np.pi * (1 + np.sqrt(5)) * number
    level = np.sqrt(1 - z * z)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), z], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class _Blocks:
    """Blocks of equal size that cover the positions. A point outside belongs to the nearest block.

    Attributes:
        low, side, number: (2,) the first corner and the sides in metres, and how many there are.
    """

    low: NDArray[np.float64]
    side: NDArray[np.float64]
    number: NDArray[np.int64]

    @classmethod
    def over(cls, positions: NDArray[np.floating]) -> _Blocks:
        low = positions[:, :2].min(axis=0).astype(np.float64)
        size = positions[:, :2].max(axis=0) - low + 1e-6
        number = np.ceil(size / BLOCK_M).astype(np.int64)
        return cls(low, size / number, number)

    @property
    def count(self) -> int:
        return int(self.number.prod())

    def of(self, points: NDArray[np.floating]) -> NDArray[np.int64]:
        """(n,) the block of each."""
        at = np.floor((points[:, :2] - self.low) / self.side).astype(np.int64)
        column, row = np.clip(at, 0, self.number - 1).T
        return column * self.number[1] + row


def _occupied(positions: NDArray[np.floating]) -> int:
    """Number of cubes of VIEWPOINT_M with a position inside."""
    return len(np.unique(cells_of(positions, VIEWPOINT_M), axis=0))


def _with_normals(blocks: list[NDArray[np.float64]], number: int) -> Surface:
    """One of the blocks' (m, 6) points and directions as a surface."""
    own = blocks[number]
    low, high = own[:, :2].min(axis=0) - BORDER_M, own[:, :2].max(axis=0) + BORDER_M
    beside = []
    for other in [*blocks[:number], *blocks[number + 1 :]]:
        near = ((other[:, :2] > low) & (other[:, :2] < high)).all(axis=1)
        beside.append(other[near])
    both = np.concatenate([own, *beside])
    return Surface.around(both[:, :3], both[:, 3:], two_faces=True).at(slice(0, len(own)))
