"""Construction of a surface grid, tile by tile: a part depends on the points in and around its tile alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ... import native
from ..made_of import Arrays, MadeOf
from .other_faces import other_faces
from .surface import Surface
from .tile_rows import TileRows, cells_a_tile, columns_of, tile_rows

BLOCK_BITS = 2  # blocks of 4 cells a side: half of the cells in kept blocks are near the surface
GROUP_BITS = 2  # groups of 4 blocks a side, or more
MAX_GROUPS = 1 << 24  # entries of the table of all groups
FACE_CELLS = 2  # that the other face of a wall may be away


@dataclass(frozen=True)
class CellsOf:
    """Cells of points, counted from a corner.

    Attributes:
        position_m: (m, 3) of the points.
        cell_m: width of a cell.
        low: (3,) int64, the first cell.
        last: (3,) int64, the last cell counted from the first.
    """

    position_m: NDArray[np.floating]
    cell_m: float
    low: NDArray[np.int64]
    last: NDArray[np.int64]

    @classmethod
    def points(cls, points: NDArray[np.floating], cell_m: float) -> CellsOf:
        """Cells of (m, 3) points in metres, from two before that of any point to two after it."""
        lowest, highest = (np.asarray(end, np.float64) for end in (points.min(axis=0), points.max(axis=0)))
        low = np.floor(lowest / cell_m).astype(np.int64) - 2
        high = np.floor(highest / cell_m).astype(np.int64) + 2
        return cls(points, cell_m, low, high - low)

    def of(self, rows: slice | NDArray[np.integer]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Cells (k, 3) of some points, and the points' positions (k, 3) in them, 0..1."""
        scaled = np.asarray(self.position_m[rows], np.float64) / self.cell_m
        cell = np.floor(scaled)
        return (cell.astype(np.int64) - self.low).astype(np.int32), (scaled - cell).astype(np.float32)


@dataclass(frozen=True)
class GridFrame:
    """Groups of a grid, which are counted from the frame's origin.

    Attributes:
        cell_m: width of a cell.
        bits: a group has 2 ** bits blocks along its edge.
        low: (3,) int64, the first group, below the cell two before that of any point. Positions outside the
            grid go there, or to the last one.
        shape: (3,) groups.
    """

    cell_m: float
    bits: int
    low: NDArray[np.int64]
    shape: NDArray[np.int64]

    @classmethod
    def of(cls, points: NDArray[np.floating], cell_m: float) -> GridFrame:
        """Frame of (m, 3) points in metres, of groups as small as MAX_GROUPS allows."""
        cells = CellsOf.points(points, cell_m)
        bits = GROUP_BITS
        while True:
            low = cells.low >> BLOCK_BITS + bits
            shape = (cells.low + cells.last >> BLOCK_BITS + bits) - low + 1
            if np.prod(shape) <= MAX_GROUPS:
                return cls(cell_m, bits, low, shape)
            bits += 1

    @property
    def cells_a_group(self) -> int:
        """Cells along the edge of a group."""
        return 1 << BLOCK_BITS + self.bits

    @property
    def corner(self) -> NDArray[np.float32]:
        """(3,) lower corner of the first group, metres."""
        return (self.low * self.cells_a_group * self.cell_m).astype(np.float32)

    @property
    def cells_a_tile(self) -> int:
        """Cells along the edge of a tile, which has whole groups."""
        return cells_a_tile(self.cells_a_group * self.cell_m) * self.cells_a_group

    def number_of(self, group: NDArray[np.integer]) -> NDArray[np.int64]:
        """(g,) place of each of (g, 3) groups in the table of all."""
        x, y, z = (group - self.low).T
        return (x * self.shape[1] + y) * self.shape[2] + z


@dataclass(frozen=True)
class GridTables:
    """Tables of ``SurfaceGrid`` by their names there."""

    other_face: NDArray[np.int32]
    group: NDArray[np.int32]
    block: NDArray[np.int32]
    point: NDArray[np.int32]


def grid_tables(surface: Surface, frame: GridFrame, made_of: MadeOf) -> GridTables:
    """The tables of a surface.

    Args:
        made_of: makes a tile's part, or takes that of an earlier build with the same surface there.
    """
    column = columns_of(surface.points, frame.cell_m)
    tiles = list(tile_rows(column, frame.cells_a_tile, FACE_CELLS))
    parts = [_part(surface.at(one.rows), one, frame, made_of) for one in tiles]
    group, block, first = _numbered_groups(frame, parts)
    other_face = np.full(len(surface), -1, np.int32)
    side = 1 << BLOCK_BITS
    point = np.full((int(block.max()) + 1, side, side, side), -1, np.int32)
    for tile, part, numbers in zip(tiles, parts, _by_part(parts, first), strict=True):
        row_of = np.append(tile.rows, np.int32(-1))  # the last is that of -1
        other_face[tile.rows[tile.own]] = row_of[part["other_face"]]
        point[numbers] = row_of[part.pop("point")]
    return GridTables(other_face, group, block, point)


def _part(surface: Surface, tile: TileRows, frame: GridFrame, made_of: MadeOf) -> Arrays:
    """The part of a tile, whose numbers are rows of the surface in and around it.

    ``other_face`` (own points,); ``group`` (g, 3) the groups that are kept, in the order of the table of all;
    ``block`` (g, s, s, s) which blocks of each are kept; ``point`` (blocks, s, s, s) of these.
    """
    side = frame.cells_a_tile
    low = np.array([*tile.tile, 0]) * side

    def make() -> Arrays:
        reach_m = FACE_CELLS * frame.cell_m
        z = np.floor(surface.points[:, 2].astype(np.float64) / frame.cell_m).astype(np.int64)
        low[2] = int(z.min()) - 1 & -frame.cells_a_group
        last = np.array([side - 1, side - 1, int(z.max()) + 1 - low[2]])
        cells = CellsOf(surface.points, frame.cell_m, low, last)
        group, block = tables_around(cells, frame.bits)
        end = int(block.max()) + 1
        rows = np.arange(len(surface), dtype=np.int32)
        return {
            "other_face": other_faces(surface, reach_m)[tile.own],
            "group": (np.argwhere(group) + low // frame.cells_a_group).astype(np.int32),
            "block": block[1:] > 0,
            "point": native.nearest_points(*cells.of(slice(None)), rows, group, block, BLOCK_BITS, 1, end),
        }

    content = [surface.points, surface.normals, surface.oriented, tile.own]
    return made_of("grid", [*content, np.array([frame.cell_m, frame.bits, side, *tile.tile])], make)


def _numbered_groups(
    frame: GridFrame, parts: Sequence[Arrays]
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
    """The tables of groups and blocks, and the number (g,) of the first block of each part's groups."""
    place = frame.number_of(np.concatenate([part["group"] for part in parts]))
    kept = np.concatenate([part["block"] for part in parts])
    order = np.argsort(place)
    group = np.zeros(frame.shape, np.int32)
    group.flat[place[order]] = np.arange(1, len(place) + 1)
    none = np.zeros((1, *kept.shape[1:]), np.bool_)
    block = _numbered(np.concatenate([none, kept[order]]))
    counts = kept.sum(axis=(1, 2, 3))
    first = np.empty(len(place), np.int64)
    first[order] = np.cumsum(counts[order]) - counts[order] + 1
    return group, block, first


def _by_part(parts: Sequence[Arrays], first: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Yield for each part the numbers (blocks,) of its blocks.

    Args:
        first: (g,) number of the first block of each part's groups.
    """
    begin = 0
    for part in parts:
        counts = part["block"].sum(axis=(1, 2, 3))
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        yield np.repeat(first[begin : begin + len(counts)], counts) + within
        begin += len(counts)


def tables_around(cells: CellsOf, bits: int = GROUP_BITS) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Tables of the groups and blocks within one cell of a point.

    Args:
        bits: a group has 2 ** bits blocks along its edge.
    """
    near = np.zeros((cells.last >> BLOCK_BITS + bits) + 1, np.bool_)
    for place, _ in _blocks_around(cells, bits):
        near.ravel()[place] = True
    group = _numbered(near)
    kept = np.zeros((int(group.max()) + 1, *3 * (1 << bits,)), np.bool_)
    for place, within in _blocks_around(cells, bits):
        kept.ravel()[(group.ravel()[place].astype(np.int64) << 3 * bits) + within] = True
    return group, _numbered(kept)


def _blocks_around(cells: CellsOf, bits: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield the blocks within one cell of points: the place of their groups, and theirs in the groups."""
    cell = cells.of(slice(None))[0].astype(np.int64)
    cell = cell[((cell >= -1) & (cell <= cells.last + 1)).all(axis=1)]
    _, rows, layers = (cells.last >> BLOCK_BITS + bits) + 1
    strides, shifts = (rows * layers, layers, 1), (2 * bits, bits, 0)
    places: list[list[NDArray[np.int64]]] = []
    withins: list[list[NDArray[np.int64]]] = []
    for axis in range(3):
        blocks = [(cell[:, axis] + step).clip(0, cells.last[axis]) >> BLOCK_BITS for step in (-1, 1)]
        places.append([(block >> bits) * strides[axis] for block in blocks])
        withins.append([(block & (1 << bits) - 1) << shifts[axis] for block in blocks])
    for x, y, z in product((0, 1), repeat=3):
        yield (
            places[0][x] + places[1][y] + places[2][z],
            withins[0][x] + withins[1][y] + withins[2][z],
        )


def _numbered(kept: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Numbers 1, 2, ... of the kept entries, 0 for the others."""
    number = np.zeros(kept.shape, np.int32)
    number[kept] = np.arange(1, kept.sum() + 1)
    return number
