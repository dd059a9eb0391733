"""Free space carved by the rays of the mapping run, as chunks: those of the poses in one tile of the map.

The rays are those of the map's sensor, from the trajectory's poses in the reconstructed mesh. They carve as
the run's own scans would (docs/method.md section 6), so nobody has to hand these in.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import RegistrationConfig
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.native import CarvedCells, take_out_near
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays, Chunk, SurfaceChange
from ..execution.stage_cache import StageResult
from ..mesh.map_tiles import by_nested_tiles
from ..mesh.places.surface_cells import surface_cells_of
from ..simulation.local_simulator import local_simulator
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright
from .views import SHARED_M

RAYS = 12_288
APART_M = 0.5  # nearer to the last one, a pose sees the same again
BACK_OFF_M = 0.3  # of a ray's end: surface and mesh are not one
SPARSE_M = 2.0  # between poses: then a cell is free that one of them saw so, otherwise two of them
MIN_CELL_M, MAX_CELL_M = 0.1, 0.25
TILE_M = 64.0
AT_ONCE = 16
_BITS = 21  # of a brick's number along each axis, in its key


@dataclass(frozen=True)
class CarveChunk(Chunk):
    """The cells that the rays of some poses pass. Reads the input ``mesh``.

    Attributes:
        tile: its number in x and y.
        poses: (n, 3) positions, in single precision.
    """

    tile: tuple[int, int]
    poses: tuple[tuple[float, float, float], ...]
    sensor: SensorModel
    cell_m: float

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """``brick`` (n, 3), and the bits (n, 8, 2) of cells passed ``once`` and ``twice`` or more."""
        simulator = self.simulator(inputs["mesh"])
        cells, rays, poses = CarvedCells(self.cell_m), rays_of(self.sensor), self.places
        for start in range(0, len(poses), AT_ONCE):
            some = poses[start : start + AT_ONCE]
            for ranges in simulator.ranges(upright(some), self.sensor, rays):
                cells.add(some[: len(ranges)], rays.directions, ranges, BACK_OFF_M)
                some = some[len(ranges) :]
        brick, once, twice = cells.bricks()
        return {"brick": brick, "once": once, "twice": twice}

    @property
    def values(self) -> dict[str, Any]:
        """Poses, sensor and cell. The tile says where the poses are."""
        return {"poses": self.poses, "sensor": asdict(self.sensor), "cell_m": self.cell_m}

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hash of the surface that can be seen from the tile."""
        low = np.array(self.tile) * TILE_M
        cells = surface_cells_of(inputs["mesh"].directory)
        return {"mesh": cells.digest_within(low, low + TILE_M, self.sensor.max_range_m)}

    def sees(self, change: SurfaceChange, inputs: Mapping[str, StageResult]) -> bool:
        """Whether a ray of a pose meets the change."""
        reach_m = self.sensor.max_range_m
        return change.is_met(self.places, rays_of(self.sensor), reach_m, reach_m)

    @property
    def places(self) -> NDArray[np.float64]:
        """(n, 3) positions of the poses."""
        return np.array(self.poses, np.float64)

    def simulator(self, mesh: Path) -> Simulator:
        """A simulator of the finished stage in a folder, as far as rays get from the tile."""
        low = np.floor((np.array(self.tile) + 0.5) * TILE_M / SHARED_M) * SHARED_M
        return local_simulator(mesh, low, low + SHARED_M, self.sensor.max_range_m)


def carve_chunks(
    trajectory: NDArray[np.float64], sensor: SensorModel, registration: RegistrationConfig
) -> list[CarveChunk]:
    """The chunks of a mapping run with (m, 4, 4) poses.

    Only the poses' places are read: which way their axes look depends on who made them.
    """
    cell_m = cell_width_m(registration)
    places = thinned(trajectory[:, :3, 3]).astype(np.float32)
    order, start = by_nested_tiles(places, SHARED_M, TILE_M)
    chunks = []
    for first, last in pairwise(start.tolist()):
        at = places[order[first:last]]
        column, row = np.floor(at[0, :2].astype(np.float64) / TILE_M).astype(int).tolist()
        chunks.append(CarveChunk((column, row), tuple(map(tuple, at.tolist())), sensor, cell_m))
    return chunks


def cell_width_m(registration: RegistrationConfig) -> float:
    """Width of the cells: the spacing of the map's points, within limits.

    The cells around a wall are not free. So small ones tell more, as far as the points fill them.
    """
    return round(float(np.clip(0.8 * registration.map_voxel_m, MIN_CELL_M, MAX_CELL_M)), 3)


def poses_needed(trajectory: NDArray[np.float64]) -> int:
    """Number of (m, 4, 4) poses that must have seen a cell free: two, or one where stations are sparse."""
    places = thinned(trajectory[:, :3, 3])
    apart_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return 2 if len(apart_m) and np.median(apart_m) <= SPARSE_M else 1


def hash_of_run(trajectory: NDArray[np.float64] | None) -> str | None:
    """Sha256 of what carves of a mapping run's (m, 4, 4) poses; None: there are none."""
    if trajectory is None:
        return None
    return sha256(thinned(trajectory[:, :3, 3]).astype(np.float32).tobytes()).hexdigest()


def thinned(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of (m, 3) places in order, those that are APART_M from the last one before them."""
    kept = [0]
    for number in range(1, len(places)):
        if np.linalg.norm(places[number] - places[kept[-1]]) >= APART_M:
            kept.append(number)
    return places[kept]


def merged(parts: Iterable[Arrays], needed: int) -> Arrays:
    """The bricks of all chunks with the ``bits`` of cells that at least one or two poses saw free."""
    found = list(parts)
    bricks = np.concatenate([one["brick"] for one in found])
    x, y, z = bricks.astype(np.int64).T + (1 << _BITS - 1)
    _, first, of_row = np.unique((x << 2 * _BITS) + (y << _BITS) + z, return_index=True, return_inverse=True)
    brick = bricks[first]
    once = np.zeros((len(brick), 8, 2), np.int32)
    twice = np.zeros_like(once)
    start = 0
    for one in found:
        rows = of_row[start : start + len(one["brick"])].ravel()
        start += len(rows)
        twice[rows] |= one["twice"] | once[rows] & one["once"]
        once[rows] |= one["once"]
    return {"brick": brick, "bits": once if needed == 1 else twice}


def seen_free(carved: Arrays, points: NDArray[np.floating], registration: RegistrationConfig) -> SeenFree:
    """The carved cells that hold none of the map's (n, 3) points, nor have one in a cell beside them."""
    cell_m = cell_width_m(registration)
    bits = take_out_near(carved["brick"], carved["bits"], np.ascontiguousarray(points, np.float64), cell_m)
    return SeenFree.of_bricks(carved["brick"], bits, cell_m)


@lru_cache(4)
def rays_of(sensor: SensorModel) -> Rays:
    """The rays of a pose, whichever way it looks."""
    return Rays.at_any_heading(sensor.coarser(RAYS))
