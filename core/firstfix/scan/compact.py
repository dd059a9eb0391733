"""Compact scan: the few kilobytes of a scan that a query needs.

Some thousand voxel means are registered, the nearest ranges by direction check free space, and the descriptor
finds candidates if the robot knows the map's parameters. ``scan.condense`` makes them on the robot,
``wire.query`` encodes them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..descriptor import Described, Descriptor, LayeredOccupancy

MAX_COMPACT_POINTS = 10_000


@dataclass(frozen=True)
class ScanDescriptor:
    """Descriptor of a scan, computed on the robot. A query may consist of it alone: it gets only candidates.

    Attributes:
        descriptor: its parameters, which must be the map's.
        occupancy: (bytes,) uint8, one row as ``descriptor.describe`` returns it.
        up: (3,) unit vector against gravity in the sensor frame, by which the scan was levelled.
        height_m: of the sensor above its floor.
    """

    descriptor: LayeredOccupancy
    occupancy: NDArray[np.uint8]
    up: NDArray[np.float64]
    height_m: float

    @property
    def rows(self) -> Described:
        """Description in the form that ``Descriptor.describe`` returns."""
        return {"occupancy": self.occupancy[None]}

    def agrees_with(self, descriptor: Descriptor) -> bool:
        """Whether a descriptor describes scans in the same way, with lengths as float32, as sent."""
        return isinstance(descriptor, LayeredOccupancy) and _form(descriptor) == _form(self.descriptor)


@dataclass(frozen=True)
class CompactScan:
    """Compact form of a scan.

    Attributes:
        points: (n, 3) float32 metres, sensor frame: an even part of the scan's voxel means.
        nearest_m: (cells,) float32, ``reduction.nearest_by_direction`` of its returns.
        described: its descriptor; None: the server computes one from the points and ranges.
        time_s: (n,) float32, mean time of the points in each voxel, in seconds from the scan's stamp, or
            None.
    """

    points: NDArray[np.float32]
    nearest_m: NDArray[np.float32]
    described: ScanDescriptor | None = None
    time_s: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.points)


def _form(descriptor: LayeredOccupancy) -> tuple[float, ...]:
    """Parameters that the bits depend on: all but the number of the key's coefficients."""
    grid = descriptor.grid
    lengths_m = np.asarray([grid.max_range_m, *descriptor.edges_m], np.float32)
    return (grid.rings, grid.sectors, *lengths_m.tolist())
