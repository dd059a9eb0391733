"""Free space of a map of which little has changed: that of the version before, but for what has changed.

The mapping run is the same; of another one all cells are carved anew. A cell outside of what has changed that
the run saw free stays free. Within it a cell is free that the rays pass which may meet the change: all that
pass such a cell are among them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import RegistrationConfig
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.native import CarvedCells
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays
from ..execution.local_executor import in_turn
from ..rebuild.base_version import BaseVersion
from ..simulation.changed_surface import ChangedSurface
from ..simulation.simulate import upright
from .carve import (
    AT_ONCE,
    BACK_OFF_M,
    CarveChunk,
    carve_chunks,
    cell_width_m,
    hash_of_run,
    merged,
    poses_needed,
    rays_of,
)

_SIDE = 8  # of a brick, in cells
_BITS = 21  # of a brick's number along each axis, in its key


def free_before(base: BaseVersion, trajectory: NDArray[np.float64]) -> SeenFree | None:
    """The free cells of the version before; None: it has none, or another mapping run saw them.

    Args:
        trajectory: (m, 4, 4) poses of the mapping run now.
    """
    return SeenFree.load(base.directory) if base.mapping_run == hash_of_run(trajectory) else None


def carved_anew(
    before: SeenFree,
    trajectory: NDArray[np.float64],
    sensor: SensorModel,
    registration: RegistrationConfig,
    change: ChangedSurface,
    mesh: Path,
    check: Callable[[], None] = lambda: None,
) -> Arrays:
    """``brick`` (n, 3) and ``bits`` (n, 8, 2) of the free cells, as ``carve.merged`` returns them.

    Args:
        before: cells of the version before.
        trajectory: (m, 4, 4) poses of the mapping run, the same as before.
        mesh: folder of the finished stage.
        check: called before each chunk; it may raise.
    """
    chunks = carve_chunks(trajectory, sensor, registration)
    near = [chunk for chunk in chunks if change.is_within(chunk.places, sensor.max_range_m)]

    def carved(chunk: CarveChunk) -> Arrays:
        check()
        return _carved(chunk, change, mesh)

    parts = [part for _, part in in_turn(carved, near)]
    cell_m = cell_width_m(registration)
    brick, bits = before.bricks
    kept = bits & ~cells_within(brick, change, cell_m)
    if not parts:
        return {"brick": brick, "bits": kept}
    new = merged(parts, poses_needed(trajectory))
    return _joined(brick, kept, new["brick"], new["bits"])


def _carved(chunk: CarveChunk, change: ChangedSurface, mesh: Path) -> Arrays:
    """The cells that rays pass which may meet the change, as ``CarveChunk.run`` gives them."""
    simulator, sensor, rays = chunk.simulator(mesh), chunk.sensor, rays_of(chunk.sensor)
    cells, poses = CarvedCells(chunk.cell_m), chunk.places
    for start in range(0, len(poses), AT_ONCE):
        some = poses[start : start + AT_ONCE]
        met = change.met_by(some, rays, sensor.max_range_m)
        facing = np.logical_or.reduce(met, axis=0)
        if not facing.any():
            continue
        cast, met = rays.of_rows(facing), met[:, facing]
        for ranges in simulator.ranges(upright(some), sensor, cast):
            ranges[~met[: len(ranges)]] = np.inf
            cells.add(some[: len(ranges)], cast.directions, ranges, BACK_OFF_M)
            some, met = some[len(ranges) :], met[len(ranges) :]
    brick, once, twice = cells.bricks()
    return {"brick": brick, "once": once, "twice": twice}


def cells_within(brick: NDArray[np.int32], change: ChangedSurface, cell_m: float) -> NDArray[np.int32]:
    """(n, 8, 2) bits of the cells of (n, 3) bricks that lie wholly in what has changed."""
    found = np.zeros((len(brick), _SIDE), np.uint64)
    if not len(brick):
        return found.view(np.int32).reshape(-1, _SIDE, 2)
    key = _key(brick)
    order = np.argsort(key)
    low = np.ceil(change.low.astype(np.float64) / cell_m).astype(np.int64)
    high = np.floor(change.high.astype(np.float64) / cell_m).astype(np.int64) - 1
    holds_any = (low <= high).all(axis=1)
    for first, last in zip(low[holds_any], high[holds_any], strict=True):
        ends = [(a, b + 1) for a, b in zip(first // _SIDE, last // _SIDE, strict=True)]
        if np.prod([b - a for a, b in ends], dtype=np.float64) > len(key):  # of a few huge triangles
            rows = np.flatnonzero(
                np.all([(a <= one) & (one < b) for (a, b), one in zip(ends, brick.T, strict=True)], axis=0)
            )
        else:
            wanted = _key(np.stack(np.meshgrid(*(np.arange(a, b) for a, b in ends)), axis=-1).reshape(-1, 3))
            at = np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)
            rows = order[at[key[order[at]] == wanted]]
        of_x, of_y, of_z = (
            (first[axis] <= cell) & (cell <= last[axis])
            for axis, number in enumerate(brick[rows].T)
            for cell in [_SIDE * number[:, None] + np.arange(_SIDE)]
        )
        cells = (of_y[:, :, None] & of_z[:, None, :]).reshape(-1, _SIDE * _SIDE)
        layer = np.packbits(cells, axis=1, bitorder="little").view("<u8")  # (k, 1)
        found[rows] |= np.where(of_x, layer, np.uint64(0))
    return found.view(np.int32).reshape(-1, _SIDE, 2)


def _joined(
    brick: NDArray[np.int32], bits: NDArray[np.int32], other: NDArray[np.int32], more: NDArray[np.int32]
) -> Arrays:
    """All bricks of both, with the bits of either."""
    both = np.concatenate([brick, other])
    _, first, of_row = np.unique(_key(both), return_index=True, return_inverse=True)
    joined = np.zeros((len(first), _SIDE, 2), np.int32)
    joined[of_row[: len(brick)]] = bits
    joined[of_row[len(brick) :]] |= more
    return {"brick": both[first], "bits": joined}


def _key(brick: NDArray[np.integer]) -> NDArray[np.int64]:
    x, y, z = brick.astype(np.int64).T + (1 << _BITS - 1)
    return (x << 2 * _BITS) + (y << _BITS) + z
