"""Assignment of keys to shards: keys of neighbouring map tiles are in one shard."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...array_file import check_numbers, map_arrays, save_arrays

TILE_M = 64.0
MAX_SHARDS = 64  # each takes a search call of its own


@dataclass(frozen=True)
class TileShards:
    """Rows, n of them, in s shards.

    Attributes:
        row: (n,) int32, shard after shard, ascending in each.
        begin: (s + 1,) int32, shard i holds ``row[begin[i]:begin[i + 1]]``.
        place: (n,) int32, position of each row in ``row``.
    """

    row: NDArray[np.int32]
    begin: NDArray[np.int32]
    place: NDArray[np.int32]

    @classmethod
    def of(cls, position_m: NDArray[np.floating], most: int) -> TileShards:
        """Shards of square tiles along a Z-order curve, each filled with as many tiles as it has room for.

        A shard holds more than ``most`` of (n, 3) positions only if one tile does, or if there would be too
        many shards.
        """
        tile = np.floor(position_m[:, :2] / TILE_M).astype(np.int64)
        code = _z_order(tile - tile.min(axis=0))
        order = np.argsort(code, kind="stable")
        first = np.flatnonzero(np.r_[True, np.diff(code[order]) != 0])  # of each tile
        begin = _filled(np.append(first, len(order)), max(most, -(-len(order) // MAX_SHARDS)))
        row = np.concatenate([np.sort(part) for part in np.split(order, begin[1:-1])]).astype(np.int32)
        place = np.empty_like(row)
        place[row] = np.arange(len(row), dtype=np.int32)
        return cls(row, begin, place)

    def __len__(self) -> int:
        return len(self.begin) - 1

    def split(self, rows: NDArray[np.integer]) -> list[tuple[int, NDArray[np.int32]]]:
        """Splits (m,) rows by shard. Returns the number of each shard with rows, and their places in it."""
        place = np.sort(self.place[rows])
        ends = np.searchsorted(place, self.begin)
        return [
            (shard, place[ends[shard] : ends[shard + 1]] - self.begin[shard])
            for shard in np.flatnonzero(np.diff(ends)).tolist()
        ]

    def save(self, path: Path) -> None:
        """Write the shards to a file."""
        save_arrays(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> TileShards:
        """Read a file that ``save`` wrote, memory-mapped.

        Raises:
            ValueError, TypeError, OSError: the file has another format or cannot be read.
        """
        shards = cls(**map_arrays(path))
        if not len(shards.row) == len(shards.place) == shards.begin[-1]:
            raise ValueError(f"{path.name}: the shards do not hold every row once")
        check_numbers(f"{path.name}: begin", shards.begin, len(shards.row) + 1, ascending=True)
        for name in ("row", "place"):
            check_numbers(f"{path.name}: {name}", getattr(shards, name), len(shards.row))
        return shards


def _filled(first: NDArray[np.int64], most: int) -> NDArray[np.int32]:
    """Begin of each shard, and the end of the last.

    Args:
        first: begin of each tile, and the end of the last.
        most: rows in a shard.
    """
    begin = [0]
    for tile in range(1, len(first) - 1):
        if first[tile + 1] - begin[-1] > most:
            begin.append(int(first[tile]))
    return np.array([*begin, first[-1]], np.int32)


def _z_order(tile: NDArray[np.int64]) -> NDArray[np.int64]:
    """Z-order codes (n,) of (n, 2) tiles: the bits of x and y alternate, so near tiles have near codes."""
    code = np.zeros(len(tile), np.int64)
    for bit in range(int(tile.max(initial=0)).bit_length()):
        for axis in range(2):
            code |= (tile[:, axis] >> bit & 1) << 2 * bit + axis
    return code
