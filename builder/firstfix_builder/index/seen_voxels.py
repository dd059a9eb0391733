"""Seen surface in small voxels, merged block by block: neither the returns nor the map are in memory.

A voxel's mean is kept in whole numbers, to a 256th of its edge. Sums of them do not depend on their order.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

BLOCK_M = 20.0  # small ones: of a hall there are several, too, for all processors
VOXEL = np.dtype([("voxel", "<i4", 3), ("offset", "u1", 3), ("toward", "i1", 3), ("count", "<u2")])
_OFFSETS, _TOWARDS, _MAX = 256, 127, 65_535
_BITS = 21  # of a voxel's number along each axis, in its key


def seen_voxels(means: NDArray[np.float64], step_m: float) -> NDArray[np.void]:
    """Voxels of edge step_m as records of type VOXEL, block after block.

    Args:
        means: (n, 7) of ``SeenSurface.means``.
    """
    found = np.empty(len(means), VOXEL)
    scaled = means[:, :3] / step_m
    voxel = np.floor(scaled)
    found["voxel"] = voxel
    found["offset"] = np.minimum((scaled - voxel) * _OFFSETS, _OFFSETS - 1)
    found["toward"] = np.rint(means[:, 3:6] * _TOWARDS)
    found["count"] = np.minimum(means[:, 6], _MAX)
    return found[np.lexsort(_blocks_of(found, step_m).T)]


def _blocks_of(voxels: NDArray[np.void], step_m: float) -> NDArray[np.int32]:
    """(n, 2) number of the block of each of (n,) voxels."""
    blocks: NDArray[np.int32] = voxels["voxel"][:, :2] // round(BLOCK_M / step_m)
    return blocks


class SeenBlocks:
    """Seen voxels of a map, in files of square blocks.

    Args:
        folder: empty; takes the files.
        step_m: edge of the voxels.
    """

    def __init__(self, folder: Path, step_m: float) -> None:
        self._folder = folder
        self._step_m = step_m
        self.blocks: set[tuple[int, int]] = set()

    def add(self, voxels: NDArray[np.void]) -> None:
        """Add what is seen from some viewpoints, as ``seen_voxels`` returns it."""
        block = _blocks_of(voxels, self._step_m)
        ends = np.flatnonzero(np.any(np.diff(block, axis=0) != 0, axis=1)) + 1
        for first, last in pairwise([0, *ends.tolist(), len(block)]):
            if first == last:
                continue
            x, y = block[first].tolist()
            self.blocks.add((x, y))
            with self._path((x, y)).open("ab") as file:
                voxels[first:last].tofile(file)

    def voxels(self, block: tuple[int, int]) -> NDArray[np.void]:
        """All that was added of a block: of a voxel there may be several records."""
        return np.fromfile(self._path(block), VOXEL)

    def _path(self, block: tuple[int, int]) -> Path:
        return self._folder / f"{block[0]}_{block[1]}.voxels"


def mean_points(voxels: NDArray[np.void], step_m: float) -> NDArray[np.float64]:
    """(m, 6) the mean point of each voxel, and the mean direction to those who see it.

    In x-y-z order of the voxels. The direction is short where they stood all around.

    Args:
        voxels: (n,) records of type VOXEL of edge step_m.
    """
    x, y, z = voxels["voxel"].astype(np.int64).T + (1 << _BITS - 1)
    key = (x << 2 * _BITS) + (y << _BITS) + z
    order = np.argsort(key, kind="stable")  # quicker: what one chunk saw is in order
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    words = voxels.view(np.int32).reshape(len(voxels), -1)  # a record is taken at once so
    voxels = words.take(order, axis=0).view(VOXEL).ravel()
    weight = voxels["count"].astype(np.int64)
    total = np.add.reduceat(weight, first)

    def weighted(name: str) -> NDArray[np.float64]:  # column by column: NumPy sums up rows slowly
        columns = (voxels[name][:, axis] * weight for axis in range(3))
        return np.stack([np.add.reduceat(column, first) / total for column in columns], axis=1)

    offset, toward = weighted("offset"), weighted("toward")
    point = (voxels["voxel"][first] + (offset + 0.5) / _OFFSETS) * step_m
    return np.concatenate([point, toward / _TOWARDS], axis=1)
