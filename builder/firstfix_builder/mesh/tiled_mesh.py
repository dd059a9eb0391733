"""A mesh whose triangles are sorted by tile, so that work at one place reads only triangles near it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import BuildFailed
from firstfix.native import by_first_use

from ..execution.local_executor import in_turn
from .map_tiles import by_tiles
from .mapped_array import mapped_array
from .mesh import Mesh, highest, longest_edge, lowest, middle
from .places.surface_cells import SurfaceCells

TILE_M = 32.0
AT_ONCE = 1_000_000  # triangles that are put in order in memory


@dataclass(frozen=True)
class TiledMesh:
    """A mesh whose triangles stand tile by tile, and whose vertices do too.

    Attributes:
        mesh: a vertex of triangles in several tiles is in each of them; in a tile, vertices stand in the
            order in which its triangles first use them.
        start: (k + 1,) int64, tile i holds ``mesh.triangles[start[i]:start[i + 1]]``.
        vertex_start: (k + 1,) int64, and ``mesh.vertices[vertex_start[i]:vertex_start[i + 1]]``.
        low, high: (k, 2) metres, the corners of the box in x and y that holds a tile's triangles whole.
    """

    mesh: Mesh
    start: NDArray[np.int64]
    vertex_start: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.low)

    @classmethod
    def of(cls, mesh: Mesh) -> TiledMesh:
        """Sort a mesh of at least one triangle, and removes unused vertices."""
        order, start = by_tiles(middle(mesh.vertices[mesh.triangles]), TILE_M)
        used, triangles, vertex_start = by_first_use(mesh.triangles[order], start, len(mesh.vertices))
        ordered = Mesh(mesh.vertices[used], triangles)
        corners = ordered.vertices[ordered.triangles, :2]
        low = np.minimum.reduceat(lowest(corners), start[:-1])
        high = np.maximum.reduceat(highest(corners), start[:-1])
        return cls(ordered, start, vertex_start, low, high)

    def save(self, directory: Path) -> None:
        """Write the files of ``Mesh.save`` and ``SurfaceCells.save``, tile_start.npy and tile_box.npy."""
        self._save_tiles(directory)
        SurfaceCells.of(self.mesh.vertices, self.mesh.triangles).save(directory)

    def _save_tiles(self, directory: Path) -> None:
        """Write the files of ``load``."""
        self.mesh.save(directory)
        self._save_places(directory)

    def _save_places(self, directory: Path) -> None:
        np.save(directory / "tile_start.npy", np.stack([self.start, self.vertex_start]))
        np.save(directory / "tile_box.npy", np.stack([self.low, self.high]))

    @classmethod
    def load(cls, directory: Path) -> TiledMesh:
        """Load a mesh, memory-mapped: only the parts in use are read from the disk."""
        vertices, triangles = (
            np.load(directory / f"{n}.npy", mmap_mode="r") for n in ("vertices", "triangles")
        )
        start, vertex_start = np.load(directory / "tile_start.npy")
        low, high = np.load(directory / "tile_box.npy")
        return cls(Mesh(vertices, triangles), start, vertex_start, low, high)

    def near(self, low: NDArray[np.float64], high: NDArray[np.float64], reach_m: float) -> tuple[int, ...]:
        """The tiles within reach_m of the box of (2,) corners, and always the nearest one."""
        gap_m = np.maximum(np.maximum(self.low - high, low - self.high), 0)
        away_m = np.hypot(gap_m[:, 0], gap_m[:, 1])
        return tuple(np.flatnonzero(away_m <= max(reach_m, float(away_m.min()))).tolist())

    def part(self, tiles: Sequence[int]) -> Mesh:
        """The triangles of the given tiles, in their order."""
        if len(tiles) == len(self):
            return self.mesh
        return Mesh.joined(self._tile(i) for i in tiles)

    def _tile(self, number: int) -> Mesh:
        first = int(self.vertex_start[number])
        triangles = self.mesh.triangles[self.start[number] : self.start[number + 1]]
        return Mesh(self.mesh.vertices[first : self.vertex_start[number + 1]], triangles - first)


def write_tiled_mesh(parts: Iterable[Mesh], directory: Path) -> None:
    """``TiledMesh.save`` of the mesh of all parts, of which AT_ONCE triangles or one part are in memory.

    Raises:
        BuildFailed: there is no triangle.
    """
    batches = _batches(parts)
    first, second = next(batches, None), next(batches, None)
    if first is None:
        raise BuildFailed("the map gives no surface: its points are too sparse or too scattered")
    if second is None:
        TiledMesh.of(first).save(directory)
        return
    with TemporaryDirectory(dir=directory) as folder:

        def tiled_in_a_file(batch: tuple[int, Mesh]) -> TiledMesh:
            number, mesh = batch
            (Path(folder) / str(number)).mkdir()
            TiledMesh.of(mesh)._save_tiles(Path(folder) / str(number))
            return TiledMesh.load(Path(folder) / str(number))

        several = enumerate(chain([first, second], batches))
        del first, second
        _merge([one for _, one in in_turn(tiled_in_a_file, several)], directory)


def _batches(parts: Iterable[Mesh]) -> Iterator[Mesh]:
    waiting: list[Mesh] = []
    for mesh in parts:
        if len(mesh.triangles):
            waiting.append(mesh)
        if sum(len(one.triangles) for one in waiting) >= AT_ONCE:
            yield Mesh.joined(waiting)
            waiting = []
    if waiting:
        yield Mesh.joined(waiting)


def _merge(tiled: Sequence[TiledMesh], directory: Path) -> None:
    """Write what several tiled meshes have, tile by tile."""
    holders: dict[tuple[float, ...], list[tuple[TiledMesh, int]]] = {}
    for one in tiled:
        corners = one.mesh.vertices[one.mesh.triangles[one.start[:-1]]]  # of the first triangle of each tile
        for number, tile in enumerate(np.floor(middle(corners)[:, :2] / TILE_M).tolist()):
            holders.setdefault(tuple(tile), []).append((one, number))
    shape = {
        "vertices": (sum(len(one.mesh.vertices) for one in tiled), np.float64),
        "triangles": (sum(len(one.mesh.triangles) for one in tiled), np.int64),
    }
    vertices, triangles = (
        mapped_array(directory / f"{name}.npy", kind, (count, 3)) for name, (count, kind) in shape.items()
    )
    start, vertex_start, tiles = [0], [0], []
    in_order = [held for _, held in sorted(holders.items(), key=lambda entry: entry[0])]
    for _, (mesh, tile) in in_turn(_joined_tile, in_order):
        start.append(start[-1] + len(mesh.triangles))
        vertex_start.append(vertex_start[-1] + len(mesh.vertices))
        vertices[vertex_start[-2] : vertex_start[-1]] = mesh.vertices
        triangles[start[-2] : start[-1]] = mesh.triangles + vertex_start[-2]
        tiles.append(tile)
    cells = [tile.cells for tile in tiles if tile.cells is not None]
    over = Mesh.joined(tile.large for tile in tiles)
    if len(over.triangles):
        cells.append(SurfaceCells.of(over.vertices, over.triangles))
    low, high = (np.array(corners) for corners in zip(*(tile.box for tile in tiles), strict=True))
    whole = TiledMesh(Mesh(vertices, triangles), np.array(start), np.array(vertex_start), low, high)
    for array in (vertices, triangles):
        array.flush()
    whole._save_places(directory)
    SurfaceCells.joined(cells).save(directory)


@dataclass(frozen=True)
class _Tile:
    """A joined tile without its mesh.

    Attributes:
        box: the two (2,) corners of ``TiledMesh``, metres.
        cells: of its triangles but the large ones; None: all are large.
        large: triangles whose cell may be that of several tiles.
    """

    box: tuple[NDArray[np.float64], NDArray[np.float64]]
    cells: SurfaceCells | None
    large: Mesh


def _joined_tile(held: Sequence[tuple[TiledMesh, int]]) -> tuple[Mesh, _Tile]:
    """The mesh of a tile that several tiled meshes hold, by their numbers of it."""
    mesh = Mesh.joined(one._tile(number) for one, number in held)
    corners = mesh.vertices[mesh.triangles]
    is_large = longest_edge(corners) > TILE_M
    cells = None if is_large.all() else SurfaceCells.of(mesh.vertices, mesh.triangles[~is_large])
    box = lowest(corners)[:, :2].min(axis=0), highest(corners)[:, :2].max(axis=0)
    return mesh, _Tile(box, cells, mesh.with_triangles(is_large))
