"""Makes the templates: descriptors of scans that are simulated at the viewpoints (paper III.A)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Described, Descriptor, LayeredOccupancy, ScanBatch
from firstfix.engine.config import DescriptorConfig
from firstfix.engine.retrieval.cascade import PREFIX
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays, Chunk, SurfaceChange
from ..execution.stage_cache import StageResult
from ..mesh.mapped_array import mapped_array
from ..mesh.places.surface_cells import surface_cells_of
from ..simulation.local_simulator import local_simulator
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright

SCANS_AT_ONCE = 128
CHUNK_SPACINGS = 16  # edge of a chunk's tile in template spacings: smaller ones limit the cost of a change
REACH_MARGIN_M = 0.1  # above the rounding of single precision


def scan_batch(
    ranges: NDArray[np.float32], directions: NDArray[np.float32], height_m: NDArray[np.floating]
) -> ScanBatch:
    """Batch of scans from the (n, rays) ranges of upright sensors at (n,) heights above their floors."""
    seen = np.isfinite(ranges)
    scan, ray = np.nonzero(seen)
    start = np.concatenate([[0], np.cumsum(seen.sum(axis=1))])
    return ScanBatch(directions[ray] * ranges[scan, ray][:, None], start, height_m.astype(np.float32))


def described_views(
    simulator: Simulator,
    sensor: SensorModel,
    rays: Rays,
    positions: NDArray[np.floating],
    height_m: NDArray[np.floating],
    descriptor: Descriptor,
) -> Described:
    """Descriptors of the clean scans of upright sensors at (n, 3) positions, (n,) heights above their floors.

    Args:
        rays: unit rays of the sensor at heading zero.
    """
    if isinstance(descriptor, LayeredOccupancy):  # computed directly, without the scans
        return {"occupancy": simulator.occupied_cells(positions, height_m, sensor, rays, descriptor)}
    ranges = np.concatenate(list(simulator.ranges(upright(positions), sensor, rays)))
    return descriptor.describe(scan_batch(ranges, rays.directions, height_m))


@dataclass(frozen=True)
class TemplatesChunk(Chunk):
    """The templates of the viewpoints of one tile of the map. Reads the stages ``mesh`` and ``viewpoints``.

    Attributes:
        first, last: rows of the viewpoints.
        tile: number of the tile in x and y.
        tile_m: its edge.
        shared_m: edge of the larger tiles whose chunks share a part of the mesh.
    """

    first: int
    last: int
    tile: tuple[int, int]
    tile_m: float
    shared_m: float
    sensor: SensorModel
    descriptor: DescriptorConfig

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The arrays of the chunk's templates."""
        positions, floor_z = self._viewpoints(inputs["viewpoints"])
        height_m = positions[:, 2] - floor_z
        simulator = local_simulator(inputs["mesh"], *self._shared_box, self._reach_m)
        descriptor, rays = self.descriptor.make(), Rays.at_any_heading(self.sensor)
        described = [
            described_views(simulator, self.sensor, rays, positions[here], height_m[here], descriptor)
            for here in (slice(i, i + SCANS_AT_ONCE) for i in range(0, len(positions), SCANS_AT_ONCE))
        ]
        return {
            "position_m": positions.astype(np.float32),
            "height_m": height_m.astype(np.float32),
            **{name: np.concatenate([one[name] for one in described]) for name in descriptor.arrays},
        }

    @property
    def values(self) -> dict[str, Any]:
        """Sensor and descriptor. Rows and tiles do not count: the viewpoints themselves are in ``reads``."""
        return {"sensor": asdict(self.sensor), "descriptor": self.descriptor}

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of the viewpoints, and of the surface that the descriptor can see from there."""
        low = np.array(self.tile) * self.tile_m
        cells = surface_cells_of(inputs["mesh"].directory)
        positions, floor_z = self._viewpoints(inputs["viewpoints"].directory)
        return {
            "viewpoints": sha256(positions.tobytes() + floor_z.tobytes()).hexdigest(),
            "mesh": cells.digest_within(low, low + self.tile_m, self._reach_m),
        }

    def sees(self, change: SurfaceChange, inputs: Mapping[str, StageResult]) -> bool:
        """Whether a ray of a viewpoint meets the change within what the descriptor can see."""
        positions, _ = self._viewpoints(inputs["viewpoints"].directory)
        rays = Rays.at_any_heading(self.sensor)
        return change.is_met(positions, rays, self._reach_m, self.sensor.max_range_m)

    def _viewpoints(self, folder: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n, 3) positions and (n,) heights of the floor."""
        positions, floor_z = (
            np.load(folder / f"{name}.npy", mmap_mode="r")[self.first : self.last]
            for name in ("positions", "floor_z")
        )
        return positions, floor_z

    @property
    def _reach_m(self) -> float:
        """Horizontal distance beyond which no return is in a cell of the descriptor."""
        return min(self.sensor.max_range_m, self.descriptor.grid.max_range_m + REACH_MARGIN_M)

    @property
    def _shared_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The (2,) corners of the larger tile."""
        low = np.floor((np.array(self.tile) + 0.5) * self.tile_m / self.shared_m) * self.shared_m
        return low, low + self.shared_m


def chunk_tile_m(tile_m: float, spacing_m: float) -> float:
    """Edge of a chunk's tile: the edge of a map tile divided by an integer."""
    return tile_m / np.ceil(tile_m / (CHUNK_SPACINGS * spacing_m))


def template_chunks(
    positions: NDArray[np.float64],
    chunk_start: NDArray[np.int64],
    tile_m: float,
    spacing_m: float,
    sensor: SensorModel,
    descriptor: DescriptorConfig,
) -> list[TemplatesChunk]:
    """The chunks for (n, 3) viewpoints that are sorted by nested tiles (``by_nested_tiles``).

    A chunk depends only on its place: additions elsewhere do not change it.

    Args:
        chunk_start: rows at which the tiles of chunks start.
        tile_m: edge of the tiles of the map.
        spacing_m: between viewpoints.
    """
    side_m = chunk_tile_m(tile_m, spacing_m)
    chunks = []
    for first, last in pairwise(chunk_start.tolist()):
        column, row = np.floor(positions[first, :2] / side_m).astype(int).tolist()
        chunks.append(TemplatesChunk(first, last, (column, row), side_m, tile_m, sensor, descriptor))
    return chunks


def write_templates(parts: Iterable[Arrays], count: int, directory: Path) -> None:
    """Write the files of ``Templates.save`` from parts, with one part in memory at a time."""
    files: dict[str, NDArray[Any]] = {}
    row = 0
    for part in parts:
        last = row + len(part["position_m"])
        for name, array in part.items():
            if name not in files:
                path = directory / f"{PREFIX}{name}.npy"
                files[name] = mapped_array(path, array.dtype, (count, *array.shape[1:]))
            files[name][row:last] = array
        row = last
    assert row == count
