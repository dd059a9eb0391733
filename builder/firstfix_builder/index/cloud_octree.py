"""Octree of a map's points with levels of detail, for viewers.

A node is a cube. It holds points that lie evenly within it; its children, cubes of half the edge, hold the
points that lie between. A viewer draws the nodes from the root on, and goes deeper where it looks closely.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_INTENSITY, CLOUD_POINTS
from firstfix.catalog.viewer_cloud import NO_NORMAL, POINT
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.align import MapSurface
from firstfix.transform import Matrix, transform_points

from ..mesh.bounds import bounds
from ..mesh.intensity import Intensity

CELLS = 128  # cells along the edge of a node, of which each gives one point at most; a power of two
LEAF_POINTS = 20_000  # so few stay together in one node
MAX_LEVELS = 20
MAX_POINTS = 50_000_000
SPARE_M = 0.01  # around the points, so that none lies on the root's border
AT_ONCE = 1 << 20  # points of which there are float64 copies
_HALF = CELLS.bit_length() - 2  # cell >> _HALF is 1 in the upper half of a node
_TAKEN = 8  # in place of an octant: the node itself keeps this point


@dataclass(frozen=True)
class Node:
    """One node of the octree.

    Attributes:
        level: 0 for the root, whose edge is 2 ** level times this one's.
        cell: (3,) number of the cube on its level, from the root's low corner.
        rows: (k,) points that it holds.
    """

    level: int
    cell: tuple[int, int, int]
    rows: NDArray[np.int32]


ROOT = Node(0, (0, 0, 0), np.zeros(0, np.int32))


@dataclass(frozen=True)
class CloudOctree:
    """Octree of n points, n at least 1. A point takes 14 or 15 bytes of memory, and 9 more in ``nodes``.

    Attributes:
        offsets_m: (n, 3) points from the root's low corner. Their order is by chance: the first point of a
            cell is then any of them, whatever order the file had.
        normals: (n, 2) as ``octahedral`` gives them; None: there are none.
        marks: (k, 3) positions by name, which the viewer draws beside the cloud.
        low_m: (3,) low corner of the root.
        edge_m: of the root.
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
        parts = [slice(first, first + AT_ONCE) for first in range(0, len(points), AT_ONCE)]
        ends = [bounds(transform_points(T, points[part])) for part in parts]
        bounds_m = np.array([np.min(ends, axis=(0, 1)), np.max(ends, axis=(0, 1))])
        marks = marks or {}
        together = [bounds_m, *(mark for mark in marks.values() if len(mark))]
        low = np.min([part.min(axis=0) for part in together], axis=0) - SPARE_M
        high = np.max([part.max(axis=0) for part in together], axis=0) + SPARE_M

        places = np.arange(len(points), dtype=np.int32)
        np.random.default_rng(0).shuffle(places)
        count = min(len(points), most_points)
        offsets = np.empty((count, 3), np.float32)
        shuffled = None if normals is None else np.empty((count, 2), np.int8)
        bright = None if intensity is None else np.empty(count, np.uint8)
        for part in parts:
            kept = places[part] < count
            place = places[part][kept]
            offsets[place] = transform_points(T, points[part][kept]) - low
            if shuffled is not None and normals is not None:
                shuffled[place] = normals[part][kept]
            if bright is not None and intensity is not None:
                bright[place] = intensity.values[part][kept]
        told = intensity if intensity is None or bright is None else replace(intensity, values=bright)
        return cls(offsets, shuffled, marks, low, float((high - low).max()), bounds_m, told)

    def nodes(self) -> Iterator[Node]:
        """The nodes, parents before children."""
        waiting = deque([Node(0, ROOT.cell, np.arange(len(self.offsets_m), dtype=np.int32))])
        while waiting:
            reached = waiting.popleft()
            if len(reached.rows) <= LEAF_POINTS or reached.level == MAX_LEVELS:
                yield reached
                continue
            kept, octant = self._first_of_cells(reached)
            yield Node(reached.level, reached.cell, reached.rows[kept])
            octant[kept] = _TAKEN
            waiting.extend(_children(reached, octant))

    def save(self, directory: Path) -> None:
        """Write ``cloud.json``, the list of nodes, and ``cloud.bin``, their points one node after the other.

        The marks follow, packed as points of the root. Where the points have an intensity,
        ``cloud_intensity.bin`` has it in their order.
        """
        found, marked, first = [], {}, 0
        with ExitStack() as files:
            file = files.enter_context((directory / CLOUD_POINTS).open("wb"))
            beside = None
            if self.intensity is not None:
                beside = files.enter_context((directory / CLOUD_INTENSITY).open("wb"))
            for node in self.nodes():
                for rows in _parts(node.rows):
                    normals = None if self.normals is None else self.normals[rows]
                    self._packed(node, self.offsets_m[rows], normals).tofile(file)
                    if beside is not None and self.intensity is not None:
                        self.intensity.values[rows].tofile(beside)
                found.append([node.level, *node.cell, first, len(node.rows)])
                first += len(node.rows)
            points = first
            for name, positions in self.marks.items():
                self._packed(ROOT, positions - self.low_m, None).tofile(file)
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

    def _first_of_cells(self, node: Node) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """Place in ``node.rows`` of the first point of each cell, ascending; and every point's octant."""
        count = len(node.rows)
        first = np.full(CELLS**3, count, np.int32)
        octant = np.empty(count, np.uint8)
        ended = count
        for rows in reversed(
            list(_parts(node.rows))
        ):  # the last that is written to a cell is its first point
            begun = ended - len(rows)
            share = self._share(node, self.offsets_m[rows])
            x, y, z = np.clip((share * CELLS).astype(np.int32), 0, CELLS - 1).T
            first[((z * CELLS + y) * CELLS + x)[::-1]] = np.arange(begun, ended, dtype=np.int32)[::-1]
            octant[begun:ended] = (x >> _HALF) | (y >> _HALF) << 1 | (z >> _HALF) << 2
            ended = begun
        return np.sort(first[first < count]), octant

    def _packed(
        self, node: Node, offsets_m: NDArray[np.floating], normals: NDArray[np.int8] | None
    ) -> NDArray[np.void]:
        packed = np.empty(len(offsets_m), POINT)
        packed["at"] = np.clip(np.rint(self._share(node, offsets_m) * 65535), 0, 65535)
        packed["normal"] = NO_NORMAL if normals is None else normals
        return packed

    def _share(self, node: Node, offsets_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """(k, 3) places in the node, 0 to 1."""
        edge_m = self.edge_m / 2**node.level
        return (offsets_m - np.array(node.cell) * edge_m) / edge_m


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
    points: NDArray[np.floating],
    positions: NDArray[np.floating],
    trajectory: NDArray[np.float64] | None,
    index: Path,
    registration: RegistrationConfig,
    T_map_level: Matrix,
    intensity: Intensity | None,
) -> None:
    """Write an octree in the map's own frame, as ``CloudOctree.save``.

    Args:
        points: (n, 3) in the index's frame; may lie in a file.
        positions: (k, 3) of the templates.
        trajectory: (p, 4, 4) poses of the mapping run, if there are any.
        index: folder with the files of the surface, which the normals are taken from.
        intensity: of the points; None: they have none.
    """
    run = np.zeros((0, 3)) if trajectory is None else trajectory[:, :3, 3]
    marks = {"templates": positions, "trajectory": run}
    moved = {name: transform_points(T_map_level, mark) for name, mark in marks.items()}
    normals = _normals_at(points, index, registration, T_map_level)
    CloudOctree.of(points, normals, moved, intensity=intensity, T_map_points=T_map_level).save(out)


def _normals_at(
    points: NDArray[np.floating], index: Path, registration: RegistrationConfig, T_map_level: Matrix
) -> NDArray[np.int8]:
    """(n, 2) normals of the surface near the points, in the map's frame, as ``octahedral`` gives them."""
    grid = MapSurface.load(index, registration).fine
    found = np.empty((len(points), 2), np.int8)
    for first in range(0, len(points), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        row = grid.nearest(np.ascontiguousarray(points[part] - grid.corner, np.float32))
        normals = np.zeros((len(row), 3))
        normals[row >= 0] = grid.planes[row[row >= 0], :3]
        found[part] = octahedral(normals @ T_map_level[:3, :3].T)
    return found
