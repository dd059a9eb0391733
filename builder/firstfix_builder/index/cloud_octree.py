"""Octree of a map's points with levels of detail, for viewers.

A node is a cube. It holds points that lie evenly within it; its children, cubes of half the edge, hold the
points that lie between. A viewer draws the nodes from the root on, and goes deeper where it looks closely.

Which points a node holds depends on those within its cube alone. So it is made cube by cube: a cube gives its
own nodes, and its share of the nodes above.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_INTENSITY, CLOUD_POINTS
from firstfix.catalog.viewer_cloud import NO_NORMAL, POINT
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.index import MAP_FILE
from firstfix.engine.made_of import Arrays, MadeOf, always
from firstfix.engine.registration.align import MapSurface
from firstfix.transform import Matrix, transform_points

from ..execution.local_executor import in_turn
from ..mesh.bounds import bounds
from ..mesh.intensity import Intensity
from ..mesh.places.chance import chance_of

CELLS = 128  # cells along the edge of a node, of which each gives one point at most; a power of two
CUBE_M = 40.0  # edge of the cubes that are made on their own, at most
LEAF_POINTS = 20_000  # so few stay together in one node
MAX_LEVELS = 20
MAX_POINTS = 50_000_000
ABOUT_M = 256.0  # a change at the first point leaves the offsets, with their rounding, as they are elsewhere
SPARE_M = 0.01  # around the points, so that none lies on the root's border
AT_ONCE = 1 << 20  # points of which there are float64 copies
_HALF = CELLS.bit_length() - 2  # cell >> _HALF is 1 in the upper half of a node
_TAKEN = 8  # in place of an octant: the node itself keeps this point
_ORDER, _THINNED = 0, 1  # seeds of chance

Cell = tuple[int, int, int]


@dataclass(frozen=True)
class Node:
    """One node of the octree.

    Attributes:
        level: 0 for the root, whose edge is 2 ** level times this one's.
        cell: (3,) number of the cube on its level, from the root's low corner.
        rows: (k,) points that it holds.
    """

    level: int
    cell: Cell
    rows: NDArray[np.int32]


ROOT = Node(0, (0, 0, 0), np.zeros(0, np.int32))


@dataclass(frozen=True)
class CloudOctree:
    """Octree of n points, n at least 1. A point takes 14 or 15 bytes of memory, and 14 more in ``save``.

    Attributes:
        offsets_m: (n, 3) points from the root's low corner.
        normals: (n, 2) as ``octahedral`` gives them; None: there are none.
        marks: (k, 3) positions by name, which the viewer draws beside the cloud.
        low_m: (3,) low corner of the root, in whole metres: a change within the map leaves it.
        edge_m: of the root, in whole metres.
        bounds_m: (2, 3) lowest and highest coordinates of the points.
        intensity: of the points; None: they have none.
    """

    offsets_m: NDArray[np.float32]
    normals: NDArray[np.int8] | None
    marks: Mapping[str, NDArray[np.float64]]
    low_m: NDArray[np.float64]
    edge_m: float
    bounds_m: NDArray[np.float64]
    intensity: Intensity | None = None

    @classmethod
    def of(
        cls,
        points: NDArray[np.floating],
        normals: NDArray[np.int8] | None = None,
        marks: Mapping[str, NDArray[np.float64]] | None = None,
        *,
        intensity: Intensity | None = None,
        T_map_points: Matrix | None = None,
        most_points: int = MAX_POINTS,
    ) -> CloudOctree:
        """Octree of a cloud, in the map's frame.

        Args:
            points: (n, 3) finite metres; may lie in a file, which is read from its beginning to its end.
            normals: (n, 2) in the map's frame, as ``octahedral`` gives them; None: there are none.
            marks: (k, 3) positions by name, in the map's frame; not thinned.
            intensity: of the points; None: they have none.
            T_map_points: where the points are in the map; None: they are in its frame.
            most_points: of a larger cloud, so many by chance.
        """
        T = np.eye(4) if T_map_points is None else T_map_points
        kept = slice(None) if len(points) <= most_points else _by_chance(points, most_points)
        count = min(len(points), most_points)
        offsets = np.empty((count, 3), np.float32)
        # the corner is not known yet
        about = ABOUT_M * np.floor(transform_points(T, points[:1])[0] / ABOUT_M)
        ends, done = [], 0
        for first in range(0, len(points), AT_ONCE):
            part = slice(first, first + AT_ONCE)
            moved = transform_points(T, points[part])
            ends.append(bounds(moved))
            chosen = moved if isinstance(kept, slice) else moved[kept[part]]
            offsets[done : done + len(chosen)] = chosen - about
            done += len(chosen)
        bounds_m = np.array([np.min(ends, axis=(0, 1)), np.max(ends, axis=(0, 1))])
        marks = marks or {}
        together = [bounds_m, *(mark for mark in marks.values() if len(mark))]
        low = np.floor(np.min([part.min(axis=0) for part in together], axis=0) - SPARE_M)
        high = np.max([part.max(axis=0) for part in together], axis=0) + SPARE_M
        offsets += (about - low).astype(np.float32)
        told = None if intensity is None else replace(intensity, values=intensity.values[kept])
        turned = None if normals is None else normals[kept]
        return cls(offsets, turned, marks, low, float(np.ceil((high - low).max())), bounds_m, told)

    @property
    def cube_level(self) -> int:
        """Level of the cubes that are made on their own: cells of all nodes above lie within one of them."""
        level = 0
        while self.edge_m / 2**level > CUBE_M and level <= _HALF and len(self.offsets_m) > LEAF_POINTS:
            level += 1
        return level

    def cubes(self) -> Iterator[tuple[Cell, NDArray[np.int64]]]:
        """Yield each cube that has points, with the rows (k,) of these, ascending."""
        side = 1 << self.cube_level
        number = np.zeros(len(self.offsets_m), np.int32)
        for axis in range(3):
            cell = (self.offsets_m[:, axis] * np.float32(side / self.edge_m)).astype(np.int32)
            number = number * side + cell.clip(0, side - 1)
        order = np.argsort(number, kind="stable")
        ends = np.flatnonzero(np.diff(number[order], prepend=-1, append=-1))
        for first, last in pairwise(ends.tolist()):
            found = int(number[order[first]])
            yield (found // side**2, found // side % side, found % side), order[first:last]

    def _made(self, cell: Cell, rows: NDArray[np.int64], made_of: MadeOf) -> Arrays:
        """A cube's share of nodes: ``nodes`` (k, 5) level, cell and number of points; ``points`` of these.

        The nodes above the cube come first. With ``intensity`` (n,) where the points have some.
        """
        level = self.cube_level
        normals = None if self.normals is None else self.normals[rows]
        told = None if self.intensity is None else replace(self.intensity, values=self.intensity.values[rows])
        own = replace(self, offsets_m=self.offsets_m[rows], normals=normals, intensity=told)

        def make() -> Arrays:
            nodes = list(own.nodes(level, cell))
            made = {
                "nodes": np.array([[node.level, *node.cell, len(node.rows)] for node in nodes]),
                "points": np.concatenate(
                    [own._packed(node, part) for node in nodes for part in _parts(node.rows)]
                ),
            }
            if told is not None:
                made["intensity"] = told.values[np.concatenate([node.rows for node in nodes])]
            return made

        content = [own.offsets_m, np.array([self.edge_m, level, *cell])]
        content += [np.zeros(0) if normals is None else normals, np.zeros(0) if told is None else told.values]
        return made_of("cube", content, make)

    def nodes(self, level: int = 0, cell: Cell = ROOT.cell) -> Iterator[Node]:
        """The nodes of a cube that holds all points, parents before children, after those above the cube.

        Chance says which point of a cell comes first, by the point's place.
        """
        rows = np.argsort(chance_of(self.offsets_m, _ORDER), kind="stable").astype(np.int32)
        for above in range(level):
            x, y, z = (one >> level - above for one in cell)
            node = Node(above, (x, y, z), rows)
            is_first, _ = self._first_of_cells(node)
            yield replace(node, rows=rows[is_first])
            rows = rows[~is_first]
            if not len(rows):  # nodes without points would only be asked for
                return
        waiting = deque([Node(level, cell, rows)])
        while waiting:
            reached = waiting.popleft()
            if len(reached.rows) <= LEAF_POINTS or reached.level == MAX_LEVELS:
                yield reached
                continue
            is_first, octant = self._first_of_cells(reached)
            yield replace(reached, rows=reached.rows[is_first])
            octant[is_first] = _TAKEN
            waiting.extend(_children(reached, octant))

    def save(self, directory: Path, made_of: MadeOf = always) -> None:
        """Write ``cloud.json``, the list of nodes, and ``cloud.bin``, their points one node after the other.

        The marks follow, packed as points of the root. Where the points have an intensity,
        ``cloud_intensity.bin`` has it in their order.

        Args:
            made_of: makes a cube's nodes, or takes those of an earlier build with the same points there.
        """
        made = [part for _, part in in_turn(lambda cube: self._made(*cube, made_of), self.cubes())]
        found, marked, first = [], {}, 0
        with ExitStack() as files:
            file = files.enter_context((directory / CLOUD_POINTS).open("wb"))
            beside = None
            if self.intensity is not None:
                beside = files.enter_context((directory / CLOUD_INTENSITY).open("wb"))
            for node, runs in _joined(made, self.cube_level):
                for part, rows in runs:
                    part["points"][rows].tofile(file)
                    if beside is not None:
                        part["intensity"][rows].tofile(beside)
                count = sum(rows.stop - rows.start for _, rows in runs)
                found.append([*node, first, count])
                first += count
            points = first
            for name, positions in self.marks.items():
                _packed(self._share(ROOT, positions - self.low_m), None).tofile(file)
                marked[name] = [first, len(positions)]
                first += len(positions)
        index = {
            "low_m": self.low_m.tolist(),
            "edge_m": self.edge_m,
            "points": points,
            "point_bytes": POINT.itemsize,
            "normals": self.normals is not None,
            "intensity": None if self.intensity is None else [self.intensity.low, self.intensity.high],
            "bounds_m": self.bounds_m.tolist(),
            "marks": marked,
            "nodes": found,
        }
        (directory / CLOUD_INDEX).write_text(json.dumps(index, separators=(",", ":")))

    def _first_of_cells(self, node: Node) -> tuple[NDArray[np.bool_], NDArray[np.uint8]]:
        """Whether each of ``node.rows`` is the first point of its cell; and every point's octant."""
        count = len(node.rows)
        cell, octant = np.empty(count, np.int32), np.empty(count, np.uint8)
        done = 0
        for rows in _parts(node.rows):
            part = slice(done, done + len(rows))
            share = self._share(node, self.offsets_m[rows])
            x, y, z = np.clip((share * CELLS).astype(np.int32), 0, CELLS - 1).T
            cell[part] = (z * CELLS + y) * CELLS + x
            octant[part] = (x >> _HALF) | (y >> _HALF) << 1 | (z >> _HALF) << 2
            done += len(rows)
        # Never cleared: what is read of it was written, of each cell its first point last.
        first = np.empty(CELLS**3, np.int32)
        number = np.arange(count, dtype=np.int32)
        first[cell[::-1]] = number[::-1]
        is_first: NDArray[np.bool_] = first[cell] == number
        return is_first, octant

    def _packed(self, node: Node, rows: NDArray[np.int32]) -> NDArray[np.void]:
        normals = None if self.normals is None else self.normals[rows]
        return _packed(self._share(node, self.offsets_m[rows]), normals)

    def _share(self, node: Node, offsets_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """(k, 3) places in the node, 0 to 1."""
        edge_m = self.edge_m / 2**node.level
        return (offsets_m - np.array(node.cell) * edge_m) / edge_m


def _packed(share: NDArray[np.float64], normals: NDArray[np.int8] | None) -> NDArray[np.void]:
    """Points at (k, 3) places in their node, 0 to 1."""
    packed = np.empty(len(share), POINT)
    packed["at"] = np.clip(np.rint(share * 65535), 0, 65535)
    packed["normal"] = NO_NORMAL if normals is None else normals
    return packed


_Runs = list[tuple[Arrays, slice]]


def _joined(made: list[Arrays], level: int) -> Iterator[tuple[tuple[int, ...], _Runs]]:
    """Yield level and cell of each node with the runs of its points, parents before children.

    Args:
        made: of each cube.
        level: of the cubes. Nodes above it have points of several.
    """
    above: dict[tuple[int, ...], _Runs] = {}
    own: list[tuple[tuple[int, ...], _Runs]] = []
    for part in made:
        ends = np.cumsum(part["nodes"][:, 4]).tolist()
        for node, run in zip(part["nodes"][:, :4].tolist(), pairwise([0, *ends]), strict=True):
            if node[0] < level:
                above.setdefault(tuple(node), []).append((part, slice(*run)))
            else:
                own.append((tuple(node), [(part, slice(*run))]))
    yield from sorted(above.items(), key=lambda item: item[0])
    yield from own


def _by_chance(points: NDArray[np.floating], count: int) -> NDArray[np.bool_]:
    """(n,) which ``count`` of (n, 3) points are taken. A point's place decides its chance."""
    starts = range(0, len(points), AT_ONCE)
    chance = np.concatenate([chance_of(points[first : first + AT_ONCE], _THINNED) for first in starts])
    taken = np.zeros(len(points), np.bool_)
    taken[np.argpartition(chance, count - 1)[:count]] = True
    return taken


def _parts(rows: NDArray[np.int32]) -> Iterator[NDArray[np.int32]]:
    return (rows[first : first + AT_ONCE] for first in range(0, len(rows), AT_ONCE))


def _children(parent: Node, octant: NDArray[np.uint8]) -> Iterator[Node]:
    for number in range(8):
        rows = parent.rows[octant == number]
        if len(rows):
            x, y, z = (2 * cell + (number >> axis & 1) for axis, cell in enumerate(parent.cell))
            yield Node(parent.level + 1, (x, y, z), rows)


def octahedral(normals: NDArray[np.floating]) -> NDArray[np.int8]:
    """(n, 2) numbers -127..127 for (n, 3) unit vectors; ``NO_NORMAL`` twice for vectors of zero.

    The sphere is folded onto a square (Cigolle et al., A Survey of Efficient Representations for Independent
    Unit Vectors, 2014).
    """
    size = np.abs(normals).sum(axis=1, keepdims=True)
    flat = normals / np.where(size > 0, size, 1)
    folded = (1 - np.abs(flat[:, [1, 0]])) * np.where(flat[:, :2] >= 0, 1, -1)
    square = np.where(flat[:, 2:] >= 0, flat[:, :2], folded)
    return np.where(size > 0, np.rint(square * 127), NO_NORMAL).astype(np.int8)


def draw_cloud(
    out: Path,
    cloud: NDArray[np.floating] | None,
    positions: NDArray[np.floating],
    trajectory: NDArray[np.float64] | None,
    index: Path,
    registration: RegistrationConfig,
    T_map_level: Matrix,
    intensity: Intensity | None,
    made_of: MadeOf = always,
) -> None:
    """Write an octree in the map's own frame, as ``CloudOctree.save``.

    Args:
        cloud: (n, 3) in the index's frame; may lie in a file. None: the points of the surface.
        positions: (k, 3) of the templates.
        trajectory: (p, 4, 4) poses of the mapping run, if there are any.
        index: folder with the files of the surface, which the normals are taken from.
        intensity: of the points; None: they have none.
        made_of: makes the nodes of a cube, or takes those of an earlier build.
    """
    run = np.zeros((0, 3)) if trajectory is None else trajectory[:, :3, 3]
    marks = {"templates": positions, "trajectory": run}
    moved = {name: transform_points(T_map_level, mark) for name, mark in marks.items()}
    points = np.load(index / MAP_FILE, mmap_mode="r") if cloud is None else cloud
    normals = _normals_at(cloud, index, registration, T_map_level)
    CloudOctree.of(points, normals, moved, intensity=intensity, T_map_points=T_map_level).save(out, made_of)


def _normals_at(
    cloud: NDArray[np.floating] | None, index: Path, registration: RegistrationConfig, T_map_level: Matrix
) -> NDArray[np.int8]:
    """(n, 2) normals in the map's frame, as ``octahedral`` gives them.

    They are those of the surface near the points of a cloud; None: of the surface's own points.
    """
    grid = MapSurface.load(index, registration).fine
    found = np.empty((len(grid.planes if cloud is None else cloud), 2), np.int8)
    for first in range(0, len(found), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        if cloud is None:
            normals = grid.planes[part, :3].astype(np.float64)
        else:
            row = grid.nearest(np.ascontiguousarray(cloud[part] - grid.corner, np.float32))
            normals = np.zeros((len(row), 3))
            normals[row >= 0] = grid.planes[row[row >= 0], :3]
        found[part] = octahedral(normals @ T_map_level[:3, :3].T)
    return found
