"""A scan in a few kilobytes: what a query needs of it, and no more.

A few thousand of its voxels are registered; how far it sees in each direction checks free space; its
descriptor, where the robot knows the map's, finds candidates. ``condense`` makes these on the robot,
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
    """A scan levelled and described on the robot. Alone it is a query too: for candidates only.

    Attributes:
        descriptor: the parameters, which must be the map's.
        occupancy: (bytes,) uint8, one row of what ``descriptor.describe`` makes.
        up: (3,) unit vector against gravity, sensor frame: how the scan was levelled.
        height_m: of the sensor above its floor.
    """

    descriptor: LayeredOccupancy
    occupancy: NDArray[np.uint8]
    up: NDArray[np.float64]
    height_m: float

    @property
    def rows(self) -> Described:
        """As a descriptor's own ``describe`` gives it."""
        return {"occupancy": self.occupancy[None]}

    def agrees_with(self, descriptor: Descriptor) -> bool:
        """Whether that one would have described the scan in the same way; lengths as float32, as they
        were sent."""
        return isinstance(descriptor, LayeredOccupancy) and _form(descriptor) == _form(self.descriptor)


@dataclass(frozen=True)
class CompactScan:
    """Attributes:
    points: (n, 3) float32 metres, sensor frame: an even part of the scan's voxel means.
    nearest_m: (cells,) float32, ``range_view.nearest_by_direction`` of its returns.
    described: None: the server describes the scan from these.
    """

    points: NDArray[np.float32]
    nearest_m: NDArray[np.float32]
    described: ScanDescriptor | None = None

    def __len__(self) -> int:
        return len(self.points)


def _form(descriptor: LayeredOccupancy) -> tuple[float, ...]:
    """What the bits depend on: not how many coefficients the key has."""
    grid = descriptor.grid
    lengths_m = np.asarray([grid.max_range_m, *descriptor.edges_m], np.float32)
    return (grid.rings, grid.sectors, *lengths_m.tolist())
