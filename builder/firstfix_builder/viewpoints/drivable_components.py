"""Chooses the connected floors that robots drive on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .floors import ColumnIndex, Grid, Surfaces

COVERED = 0.8  # share of a storey that has something overhead
OVER_FLOOR = 0.5  # share of a roof that has a floor below it
COMPARABLE = 0.2  # of the main floor's area: a storey, and not a cupboard
SEED_RADIUS_M = 1.5
SEED_DROP_M = 5.0


def components_under(
    grid: Grid, floors: Surfaces, part: NDArray[np.int64], places: NDArray[np.float64]
) -> NDArray[np.int64]:
    """The parts that (k, 3) places stand on: each falls to the highest floor below it or beside that."""
    index = ColumnIndex(grid, floors)
    reach = int(np.ceil(SEED_RADIUS_M / grid.cell_m))
    offsets = np.array([(x, y) for x in range(-reach, reach + 1) for y in range(-reach, reach + 1)])
    offsets = offsets[np.argsort(np.hypot(*offsets.T), kind="stable")]
    offsets = offsets[np.hypot(*offsets.T) * grid.cell_m <= SEED_RADIUS_M]
    column, z = grid.column_of(places), places[:, 2]
    landed = np.full(len(places), -1)
    for offset in offsets:  # nearest column first
        falling = np.flatnonzero(landed < 0)
        if len(falling) == 0:
            break
        landed[falling] = index.nearest(column[falling] + offset, z[falling], SEED_DROP_M, below=True)
    return np.unique(part[landed[landed >= 0]])


def drivable_components(
    grid: Grid, standing: Surfaces, floors: Surfaces, part: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Without any hint: the largest part that is no roof, and the other storeys of comparable size.

    Args:
        standing: all surfaces level and high enough to stand on, also where a body does not fit.
    """
    count = int(part.max()) + 1
    area = np.bincount(part, minlength=count)
    covered = np.bincount(part, np.isfinite(floors.headroom_m), minlength=count) / area
    # a floor with another floor below it, anywhere in the column: then it is not the lowest of it
    flat = standing.column[:, 0] * grid.size[1] + standing.column[:, 1]
    lowest = np.full(int(np.prod(grid.size)), np.inf)
    np.minimum.at(lowest, flat, standing.z)
    own = floors.column[:, 0] * grid.size[1] + floors.column[:, 1]
    above = np.bincount(part, floors.z > lowest[own] + 0.5, minlength=count) / area
    roof = (above > OVER_FLOOR) & (covered < COVERED)
    main = int(np.argmax(np.where(roof.all() | ~roof, area, 0)))
    storey = (covered >= COVERED) & (area >= COMPARABLE * area[main])
    storey[main] = True
    return np.flatnonzero(storey)
