"""Simulated scans at the viewpoints, described: the templates (paper III.A)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Described, Descriptor, LayeredOccupancy, ScanBatch
from firstfix.engine.config import DescriptorConfig
from firstfix.engine.retrieval.templates import PREFIX
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays, Chunk
from ..simulation.local_simulator import local_simulator
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright

SCANS_AT_ONCE = 128
CHUNK_SPACINGS = 16.0  # edge of the squares, of one chunk each: 256 viewpoints of a storey


def scan_batch(
    ranges: NDArray[np.float32], directions: NDArray[np.float32], height_m: NDArray[np.floating]
) -> ScanBatch:
    """(n, rays) ranges of upright sensors, (n,) above their floors, to the returns of all scans."""
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
    """Describes the clean scans of upright sensors at (n, 3) positions, (n,) above their floors.

    Args:
        rays: unit rays of the sensor at heading zero.
    """
    if isinstance(descriptor, LayeredOccupancy):  # its scans are never made
        return {"occupancy": simulator.occupied_cells(positions, height_m, sensor, rays, descriptor)}
    ranges = np.concatenate(list(simulator.ranges(upright(positions), sensor, rays)))
    return descriptor.describe(scan_batch(ranges, rays.directions, height_m))


@dataclass(frozen=True)
class TemplatesChunk(Chunk):
    """The templates of one square of the map. Reads the stages ``mesh`` and ``viewpoints``.

    Attributes:
        first, last: rows of the viewpoints.
        low, high: metres, the corners of the square's tile in x and y: chunks of a tile see the same part of
            the mesh.
    """

    first: int
    last: int
    low: tuple[float, float]
    high: tuple[float, float]
    sensor: SensorModel
    descriptor: DescriptorConfig

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """Returns the arrays of the chunk's templates."""
        positions, floor_z = (
            np.load(inputs["viewpoints"] / f"{name}.npy", mmap_mode="r")[self.first : self.last]
            for name in ("positions", "floor_z")
        )
        height_m = positions[:, 2] - floor_z
        simulator = local_simulator(
            inputs["mesh"], np.array(self.low), np.array(self.high), self.sensor.max_range_m
        )
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


def template_chunks(
    positions: NDArray[np.float64],
    tile_start: NDArray[np.int64],
    tile_m: float,
    square_m: float,
    sensor: SensorModel,
    descriptor: DescriptorConfig,
) -> list[TemplatesChunk]:
    """The work for (n, 3) viewpoints that stand tile by tile, and within a tile square by square.

    Tiles and squares are counted from the frame's origin: what one of them holds depends on no other.
    """
    square = np.floor(positions[:, :2] / square_m)
    is_new = np.any(np.diff(square, axis=0) != 0, axis=1)
    starts = np.union1d(np.flatnonzero(is_new) + 1, tile_start).tolist()
    chunks = []
    for first, last in pairwise(starts):
        west, south = (np.floor(positions[first, :2] / tile_m) * tile_m).tolist()
        low, high = (west, south), (west + tile_m, south + tile_m)
        chunks.append(TemplatesChunk(first, last, low, high, sensor, descriptor))
    return chunks


def write_templates(parts: Iterable[Arrays], count: int, directory: Path) -> None:
    """``Templates.save`` of templates that come in parts, one of which is in memory at a time."""
    files: dict[str, NDArray[Any]] = {}
    row = 0
    for part in parts:
        last = row + len(part["position_m"])
        for name, array in part.items():
            if name not in files:
                path = directory / f"{PREFIX}{name}.npy"
                files[name] = np.lib.format.open_memmap(
                    path, mode="w+", dtype=array.dtype, shape=(count, *array.shape[1:])
                )
            files[name][row:last] = array
        row = last
    assert row == count
