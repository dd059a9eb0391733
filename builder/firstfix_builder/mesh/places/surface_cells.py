"""The surface of a map in cubic cells with hashes: whether it has changed near a place."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.catalog.manifest import SURFACE_FILE

from ..mesh import highest, longest_edge, lowest, middle
from .chance import begins_run

CELL_M = 4.0
GROUP = 64  # cells side by side that are looked at together


@dataclass(frozen=True)
class SurfaceCells:
    """The cells that hold triangles. A triangle belongs to the cell of its centre.

    A triangle larger than a cell belongs to a cell of twice, four times ... the edge: small cells have small
    boxes.

    Attributes:
        cell: (k, 4) int64 number of each cell, counted from zero, and how often its edge is doubled.
        sha256: (k, 32) uint8 of the cell's triangles, as rays meet them: in single precision.
        low, high: (k, 3) metres, the corners of the box that holds the cell's triangles whole.
    """

    cell: NDArray[np.int64]
    sha256: NDArray[np.uint8]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> SurfaceCells:
        """Cells of (t, 3) triangles, one or more."""
        number = cells_of(vertices, triangles)
        order = np.lexsort(number.T[::-1])
        number = number[order]
        corners = vertices[triangles[order]].astype(np.float32)  # (t, 3, 3)
        first = np.flatnonzero(begins_run(number))
        ends = [*first.tolist(), len(corners)]
        found = b"".join(hashlib.sha256(corners[a:b].tobytes()).digest() for a, b in pairwise(ends))
        return cls(
            number[first],
            np.frombuffer(found, np.uint8).reshape(-1, 32),
            np.minimum.reduceat(lowest(corners), first).astype(np.float64),
            np.maximum.reduceat(highest(corners), first).astype(np.float64),
        )

    @classmethod
    def joined(cls, parts: Sequence[SurfaceCells]) -> SurfaceCells:
        """Cells of which none is in two parts."""
        joined = cls(*(np.concatenate([getattr(one, field.name) for one in parts]) for field in fields(cls)))
        order = np.lexsort(joined.cell.T[::-1])
        return cls(*(getattr(joined, field.name)[order] for field in fields(cls)))

    def save(self, directory: Path) -> None:
        """Write the file of this name."""
        np.savez(directory / SURFACE_FILE, cell=self.cell, sha256=self.sha256, low=self.low, high=self.high)

    @classmethod
    def load(cls, directory: Path) -> SurfaceCells:
        """Read the file of ``save``."""
        with np.load(directory / SURFACE_FILE) as cells:
            return cls(**dict(cells))

    @property
    def hashed(self) -> NDArray[np.int64]:
        """(k, 8) each cell with the hash of what it holds."""
        return np.concatenate([self.cell, np.ascontiguousarray(self.sha256).view(np.int64)], axis=1)

    def digest_within(self, low: NDArray[np.float64], high: NDArray[np.float64], reach_m: float) -> str:
        """A hash of the surface within reach_m of the box of (2,) corners in x and y."""
        start, group_low, group_high = self._groups
        groups = np.flatnonzero(_is_near(group_low, group_high, low, high, reach_m))
        none = np.zeros(0, np.int64)
        rows = np.concatenate([none, *(np.arange(start[i], start[i + 1]) for i in groups)])
        near = rows[_is_near(self.low[rows, :2], self.high[rows, :2], low, high, reach_m)]
        return hashlib.sha256(self.cell[near].tobytes() + self.sha256[near].tobytes()).hexdigest()

    @cached_property
    def _groups(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Rows one after the other in groups: (g + 1,) the first of each, (g, 2) corners of their boxes."""
        start = np.append(np.arange(-(-len(self.cell) // GROUP)) * GROUP, len(self.cell))
        return (
            start,
            np.minimum.reduceat(self.low[:, :2], start[:-1]),
            np.maximum.reduceat(self.high[:, :2], start[:-1]),
        )


@lru_cache(2)
def surface_cells_of(mesh: Path) -> SurfaceCells:
    """The cells of a finished mesh stage, read once for all chunks."""
    return SurfaceCells.load(mesh)


def _is_near(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    box_low: NDArray[np.float64],
    box_high: NDArray[np.float64],
    reach_m: float,
) -> NDArray[np.bool_]:
    """(k,) which of (k, 2) boxes are within reach_m of a box."""
    gap_m = np.maximum(np.maximum(low - box_high, box_low - high), 0)
    near: NDArray[np.bool_] = np.hypot(gap_m[:, 0], gap_m[:, 1]) <= reach_m
    return near


def rows_in(rows: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) which of (n, k) rows are among (m, k) others."""
    whole = np.dtype((np.void, rows.shape[1] * rows.itemsize))
    mine, theirs = (np.ascontiguousarray(one, np.int64).view(whole).ravel() for one in (rows, others))
    found: NDArray[np.bool_] = np.isin(mine, theirs)
    return found


def cells_of(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """(t, 4) the cell of each of (t, 3) triangles."""
    corners = vertices[triangles]
    doubled = np.ceil(np.log2(np.maximum(longest_edge(corners) / CELL_M, 1.0)))
    number = np.floor(middle(corners) / (CELL_M * 2**doubled)[:, None])
    return np.column_stack([number, doubled]).astype(np.int64)
