"""Views of the surface from the viewpoints of one tile of a map, as a chunk of the index's stage.

Most surfaces are seen from near by, from many places. What no robot comes near, a roof or a hill, is seen
well enough from few places. So most views end at NEAR_M, and a change of the map touches few of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.native import SeenSurface
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays, Chunk, SurfaceChange
from ..execution.stage_cache import StageResult
from ..mesh.map_tiles import by_nested_tiles
from ..mesh.places.chance import rows_by_cell
from ..mesh.places.surface_cells import surface_cells_of
from ..simulation.local_simulator import local_simulator
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright
from .seen_voxels import seen_voxels

STEP_M = 0.1  # between the points that are seen
RAYS, RAYS_ALL_ROUND = 12_288, 4096
TEMPLATES_A_VIEW = 3  # in rooms, where they stand half a metre apart, a cell then has twelve views
CELL_HEIGHT_M = 3.0  # storeys count as places of their own
NEAR_M = 15.0
SHARED_M = 512.0  # edge of the tiles whose chunks share a part of the mesh
AT_ONCE = 16


@dataclass(frozen=True)
class Reach:
    """Views of one length.

    Attributes:
        tile_m: edge of a chunk's tile.
        cell_m: edge of the square cells that viewpoints are chosen in.
        views: most viewpoints of a cell.
        beyond_m, within_m: only returns further than the one, and no further than the other, count.
    """

    tile_m: float
    cell_m: float
    views: int
    beyond_m: float
    within_m: float


NEAR = Reach(16.0, 3.0, 12, 0.0, NEAR_M)
FAR = Reach(64.0, 6.0, 2, NEAR_M, np.inf)
REACHES = (NEAR, FAR)
PROVISIONAL_REACHES = (Reach(64.0, 6.0, 1, 0.0, np.inf),)


@dataclass(frozen=True)
class ViewsChunk(Chunk):
    """The surface that is seen from some viewpoints of one tile. Reads the input ``mesh``.

    Attributes:
        tile: its number in x and y.
        viewpoints: (n, 3) metres, in single precision.
    """

    tile: tuple[int, int]
    viewpoints: tuple[tuple[float, float, float], ...]
    sensor: SensorModel
    reach: Reach

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """``voxels`` (``seen_voxels.VOXEL``)."""
        return {"voxels": views(self.simulator(inputs["mesh"]), self.places, self.sensor, self.reach)}

    @property
    def values(self) -> dict[str, Any]:
        """Viewpoints, sensor and reach. The tile says where the viewpoints stand."""
        return {"viewpoints": self.viewpoints, "sensor": asdict(self.sensor), "reach": asdict(self.reach)}

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hash of the surface that can be seen from the tile."""
        low = np.array(self.tile) * self.reach.tile_m
        cells = surface_cells_of(inputs["mesh"].directory)
        return {"mesh": cells.digest_within(low, low + self.reach.tile_m, self.reach_m)}

    def sees(self, change: SurfaceChange, inputs: Mapping[str, StageResult]) -> bool:
        """Whether a ray of a viewpoint meets the change."""
        return change.is_met(self.places, rays_of(self.sensor), self.reach_m, self.reach_m)

    @property
    def places(self) -> NDArray[np.float32]:
        """(n, 3) viewpoints."""
        return np.array(self.viewpoints, np.float32)

    @property
    def reach_m(self) -> float:
        """Length of the rays."""
        return min(self.sensor.max_range_m, self.reach.within_m)

    def simulator(self, mesh: Path) -> Simulator:
        """A simulator of the finished stage in a folder, as far as rays get from the tile."""
        return local_simulator(mesh, *self._shared_box, self.reach_m)

    @property
    def _shared_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The (2,) corners of the larger tile."""
        low = np.floor((np.array(self.tile) + 0.5) * self.reach.tile_m / SHARED_M) * SHARED_M
        return low, low + SHARED_M


def view_chunks(
    positions: NDArray[np.floating], sensor: SensorModel, reaches: Sequence[Reach] = REACHES
) -> list[ViewsChunk]:
    """The chunks of a map with templates at (n, 3) positions. A tile's own positions decide its chunk."""
    return [
        ViewsChunk(tile, tuple(map(tuple, at.astype(np.float32).tolist())), sensor, reach)
        for reach in reaches
        for tile, at in _tiles(positions, reach)
    ]


def views_in(simulator: Simulator, positions: NDArray[np.floating], sensor: SensorModel) -> Iterator[Arrays]:
    """The results of ``view_chunks`` at (n, 3) positions, in a map that is one simulator's mesh."""
    for chunk in view_chunks(positions, sensor):
        yield {"voxels": views(simulator, chunk.places, sensor, chunk.reach)}


def views(
    simulator: Simulator, viewpoints: NDArray[np.float32], sensor: SensorModel, reach: Reach
) -> NDArray[np.void]:
    """The voxels (``seen_voxels.VOXEL``) that are seen from (n, 3) viewpoints.

    Most rays go where this sensor looks, the rest in all directions, for sensors that look elsewhere.
    """
    rays = rays_of(sensor)
    cut = replace(sensor, max_range_m=min(sensor.max_range_m, reach.within_m))
    surface = SeenSurface(STEP_M)
    for start in range(0, len(viewpoints), AT_ONCE):
        some = np.ascontiguousarray(viewpoints[start : start + AT_ONCE])
        for ranges in simulator.ranges(upright(some), cut, rays):
            ranges[ranges <= reach.beyond_m] = np.inf
            surface.add(some[: len(ranges)], rays.directions, ranges)
            some = some[len(ranges) :]
    return seen_voxels(surface.means(), STEP_M)


def _tiles(
    positions: NDArray[np.floating], reach: Reach
) -> Iterator[tuple[tuple[int, int], NDArray[np.floating]]]:
    """Each tile's number with its viewpoints, some of (n, 3) positions."""
    cell_m = (reach.cell_m, reach.cell_m, CELL_HEIGHT_M)
    chosen = positions[rows_by_cell(positions, cell_m, reach.views, TEMPLATES_A_VIEW)]
    order, start = by_nested_tiles(chosen, SHARED_M, reach.tile_m)
    for first, last in pairwise(start.tolist()):
        at = chosen[order[first:last]]
        at = at[np.lexsort(at.T)]
        column, row = np.floor(at[0, :2].astype(np.float64) / reach.tile_m).astype(int).tolist()
        yield (column, row), at


@lru_cache(4)
def rays_of(sensor: SensorModel) -> Rays:
    """The rays of a view: those of the sensor at any heading, and some in all directions."""
    probe = sensor.coarser(RAYS)
    return Rays.of(np.concatenate([Rays.at_any_heading(probe).directions, _all_round(RAYS_ALL_ROUND)]))


def _all_round(count: int) -> NDArray[np.float32]:
    """Unit vectors (count, 3), evenly distributed over the sphere: a Fibonacci lattice."""
    number = np.arange(count) + 0.5
    z, azimuth = 1 - 2 * number / count, np.pi * (1 + np.sqrt(5)) * number
    level = np.sqrt(1 - z * z)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), z], axis=-1).astype(np.float32)
