"""Which keys go into which shard: those of neighbouring map tiles together."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...array_file import map_arrays, save_arrays

TILE_M = 64.0
MOST_SHARDS = 64  # each is searched by a call of its own


@dataclass(frozen=True)
class TileShards:
    """n rows in s shards.

    Attributes:
        row: (n,) int32, shard after shard, ascending in each.
        begin: (s + 1,) int32, shard i holds ``row[begin[i]:begin[i + 1]]``.
        place: (n,) int32, where in ``row`` each row stands.
    """

    row: NDArray[np.int32]
    begin: NDArray[np.int32]
    place: NDArray[np.int32]

    @classmethod
    def of(cls, position_m: NDArray[np.floating], most: int) -> TileShards:
        """Of square tiles along a Z-order curve, as many as there is room for: a shard holds more than
        ``most`` of (n, 3) places only where one tile does, or where there would be too many shards."""
        tile = np.floor(position_m[:, :2] / TILE_M).astype(np.int64)
        code = _z_order(tile - tile.min(axis=0))
        order = np.argsort(code, kind="stable")
        first = np.flatnonzero(np.r_[True, np.diff(code[order]) != 0])  # of each tile
        begin = _filled(np.append(first, len(order)), max(most, -(-len(order) // MOST_SHARDS)))
        row = np.concatenate([np.sort(part) for part in np.split(order, begin[1:-1])]).astype(np.int32)
        place = np.empty_like(row)
        place[row] = np.arange(len(row), dtype=np.int32)
        return cls(row, begin, place)

    def __len__(self) -> int:
        return len(self.begin) - 1

    def split(self, rows: NDArray[np.integer]) -> list[tuple[int, NDArray[np.int32]]]:
        """(m,) rows by shard, only of the shards that hold some: its number, and places within it."""
        place = np.sort(self.place[rows])
        ends = np.searchsorted(place, self.begin)
        return [
            (shard, place[ends[shard] : ends[shard + 1]] - self.begin[shard])
            for shard in np.flatnonzero(np.diff(ends)).tolist()
        ]

    def save(self, path: Path) -> None:
        save_arrays(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> TileShards:
        """Memory-mapped.

        Raises:
            ValueError, TypeError, OSError: it is no such file.
        """
        shards = cls(**map_arrays(path))
        if not len(shards.row) == len(shards.place) == shards.begin[-1]:
            raise ValueError(f"{path.name}: shards of another number of rows")
        return shards


def _filled(first: NDArray[np.int64], most: int) -> NDArray[np.int32]:
    """Where shards begin, and the end of the last.

    Args:
        first: of every tile, and the end of the last.
    """
    begin = [0]
    for tile in range(1, len(first) - 1):
        if first[tile + 1] - begin[-1] > most:
            begin.append(int(first[tile]))
    return np.array([*begin, first[-1]], np.int32)


def _z_order(tile: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n, 2) to (n,): the bits of x and y in turns, so that near tiles have near numbers."""
    code = np.zeros(len(tile), np.int64)
    for bit in range(int(tile.max(initial=0)).bit_length()):
        for axis in range(2):
            code |= (tile[:, axis] >> bit & 1) << 2 * bit + axis
    return code
