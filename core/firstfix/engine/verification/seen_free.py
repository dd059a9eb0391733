"""Space that the mapping run saw free. At its own place, a scan has few points there."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import native
from ..array_file import map_arrays, save_arrays

SEEN_FREE_FILE = "seen_free.safetensors"
_SIDE = 8  # of a brick in cells, and of a group in bricks


@dataclass(frozen=True)
class SeenFree:
    """Cells that were seen free, a bit each, in bricks of 8 x 8 x 8 cells. Thread-safe.

    Bricks lie in groups of 8 x 8 x 8. Only bricks and groups with such a cell are kept. All other space is
    near a surface of the map, or was never seen: nothing is said of it.

    Attributes:
        cell: (1,) float32, width of a cell in metres.
        corner: (3,) float32, metres, of the first group.
        group: (gx, gy, gz) int32, number of the kept group at each position; 0: none.
        brick: (kept groups, 8, 8, 8) int32, number of the kept brick at each position; 0: none.
        bits: (kept bricks, 8, 2) int32: layers along x of 64 cells, y by y, the lower 32 bits first.
    """

    cell: NDArray[np.float32]
    corner: NDArray[np.float32]
    group: NDArray[np.int32]
    brick: NDArray[np.int32]
    bits: NDArray[np.int32]

    def __post_init__(self) -> None:
        _ = self.tables  # checks types and shapes

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def tables(self) -> native.SeenFree:
        """The arrays as the kernel reads them."""
        return native.SeenFree(float(self.cell.item()), self.corner, self.group, self.brick, self.bits)

    @classmethod
    def of_bricks(cls, brick: NDArray[np.int32], bits: NDArray[np.int32], cell_m: float) -> SeenFree:
        """Tables of bricks.

        Args:
            brick: (n, 3) numbers of different bricks, counted from the frame's origin.
            bits: (n, 8, 2) of each.
        """
        filled = bits.any(axis=(1, 2))
        brick, bits = brick[filled].astype(np.int64), bits[filled]
        group_of = brick // _SIDE
        low = group_of.min(axis=0) if len(brick) else np.zeros(3, np.int64)
        shape = group_of.max(axis=0) - low + 1 if len(brick) else np.ones(3, np.int64)
        place, number = np.unique(np.ravel_multi_index((group_of - low).T, shape), return_inverse=True)
        group = np.zeros(shape, np.int32)
        group.flat[place] = np.arange(1, len(place) + 1)
        table = np.zeros((len(place) + 1, _SIDE, _SIDE, _SIDE), np.int32)
        x, y, z = (brick % _SIDE).T
        table[number + 1, x, y, z] = np.arange(1, len(brick) + 1)
        none = np.zeros((1, _SIDE, 2), np.int32)
        corner = (low * _SIDE * _SIDE * cell_m).astype(np.float32)
        return cls(np.array([cell_m], np.float32), corner, group, table, np.concatenate([none, bits]))

    @property
    def bricks(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Numbers (n, 3) of the bricks, counted from the frame's origin, and their bits (n, 8, 2).

        ``of_bricks`` makes the same tables of them.
        """
        group = np.argwhere(self.group)
        number, *within = np.nonzero(self.brick)
        place = np.zeros((len(self.brick), 3), np.int64)
        place[self.group[tuple(group.T)]] = group
        low = np.rint(self.corner.astype(np.float64) / (_SIDE * _SIDE * float(self.cell[0]))).astype(np.int64)
        brick = (place[number] + low) * _SIDE + np.stack(within, axis=1)
        return brick.astype(np.int32), self.bits[self.brick[(number, *within)]]

    def shares(self, points: NDArray[np.float32], T_level_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) shares, 0..1, of a scan's (n, 3) points that lie in seen-free cells, at (k, 4, 4) poses."""
        return self.tables.shares(points, T_level_sensor)

    def holds(self, points: NDArray[np.float32], T_level_sensor: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which of a scan's (n, 3) points lie in seen-free cells, at a (4, 4) pose."""
        return self.tables.holds(points, T_level_sensor)

    def save(self, directory: Path) -> None:
        """Write a version's file."""
        save_arrays(
            directory / SEEN_FREE_FILE, {field.name: getattr(self, field.name) for field in fields(self)}
        )

    @classmethod
    def load(cls, directory: Path) -> SeenFree | None:
        """Read a version's file, memory-mapped; None: the version has none, and nothing is known.

        Raises:
            ValueError, TypeError, OSError: the file has another format or cannot be read.
        """
        path = directory / SEEN_FREE_FILE
        return cls(**map_arrays(path)) if path.exists() else None
