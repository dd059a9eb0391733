"""Octree of a map's points with levels of detail, for viewers.

A node is a cube. It holds points that lie evenly within it; its children, cubes of half the edge, hold the
points that lie between. A viewer draws the nodes from the root on, and goes deeper where it looks closely.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.native import first_in_voxel
from firstfix.scan.voxel_filter import rows_by_voxel_hash

INDEX_FILE, POINTS_FILE = "cloud.json", "cloud.bin"
CELLS = 128  # cells along the edge of a node, of which each gives one point at most
LEAF_POINTS = 20_000  # so few stay together in one node
MOST_LEVELS = 20
MOST_POINTS = 50_000_000
SPARE_M = 0.01  # around the points, so that none lies on the root's border
POINT = np.dtype(
    [("at", "<u2", 3), ("normal", "i1", 2)]
)  # at: in 1/65535 of the node's edge from its low corner
NO_NORMAL = -128  # both numbers, where a point has none


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
    rows: NDArray[np.int64]


ROOT = Node(0, (0, 0, 0), np.zeros(0, np.int64))


@dataclass(frozen=True)
class CloudOctree:
    """Octree of (n, 3) points, n at least 1.

    Attributes:
        normals: (n, 3) unit, or 0; None: there are none.
        marks: (k, 3) positions by name, which the viewer draws beside the cloud.
        low_m: (3,) low corner of the root.
        edge_m: of the root.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float32] | None
    marks: Mapping[str, NDArray[np.float64]]
    low_m: NDArray[np.float64]
    edge_m: float

    @classmethod
    def of(
        cls,
        points: NDArray[np.float64],
        normals: NDArray[np.float32] | None = None,
        marks: Mapping[str, NDArray[np.float64]] | None = None,
        most_points: int = MOST_POINTS,
    ) -> CloudOctree:
        """Octree of a cloud, in the cloud's own frame.

        Args:
            points: (n, 3) finite metres.
            normals: (n, 3) unit, 0 where it is not known; None: there are none.
            marks: (k, 3) positions by name; not thinned.
            most_points: a larger cloud is thinned.
        """
        if len(points) > most_points:
            extent_m = float(np.ptp(points, axis=0).max())
            kept = rows_by_voxel_hash(points, max(extent_m / 2**12, 1e-3), most_points)
            points, normals = points[kept], None if normals is None else normals[kept]
        marks = marks or {}
        together = [points, *(mark for mark in marks.values() if len(mark))]
        low = np.min([part.min(axis=0) for part in together], axis=0) - SPARE_M
        high = np.max([part.max(axis=0) for part in together], axis=0) + SPARE_M
        return cls(points, normals, marks, low, float((high - low).max()))

    def nodes(self) -> Iterator[Node]:
        """The nodes, parents before children."""
        # by chance: the first point of a cell is then any of them, whatever order the file had
        shuffled = np.random.default_rng(0).permutation(len(self.points))
        waiting = deque([replace(ROOT, rows=shuffled)])
        while waiting:
            reached = waiting.popleft()
            if len(reached.rows) <= LEAF_POINTS or reached.level == MOST_LEVELS:
                yield reached
                continue
            within = self.points[reached.rows] - self._low_of(reached)
            kept = first_in_voxel(within, self._edge_of(reached) / CELLS)
            yield Node(reached.level, reached.cell, reached.rows[kept])
            left = np.ones(len(within), bool)
            left[kept] = False
            waiting.extend(self._children(reached, reached.rows[left], within[left]))

    def save(self, directory: Path) -> None:
        """Writes ``cloud.json``, the list of nodes, and ``cloud.bin``, their points one node after the other.

        The marks follow, packed as points of the root.
        """
        found, marked, first = [], {}, 0
        with (directory / POINTS_FILE).open("wb") as file:
            for node in self.nodes():
                normals = None if self.normals is None else self.normals[node.rows]
                self._packed(node, self.points[node.rows], normals).tofile(file)
                found.append([node.level, *node.cell, first, len(node.rows)])
                first += len(node.rows)
            points = first
            for name, positions in self.marks.items():
                self._packed(ROOT, positions, None).tofile(file)
                marked[name] = [first, len(positions)]
                first += len(positions)
        index = {
            "low_m": self.low_m.tolist(),
            "edge_m": self.edge_m,
            "points": points,
            "point_bytes": POINT.itemsize,
            "normals": self.normals is not None,
            "bounds_m": [self.points.min(axis=0).tolist(), self.points.max(axis=0).tolist()],
            "marks": marked,
            "nodes": found,
        }
        (directory / INDEX_FILE).write_text(json.dumps(index, separators=(",", ":")))

    def _children(self, parent: Node, rows: NDArray[np.int64], within: NDArray[np.float64]) -> Iterator[Node]:
        upper = within >= self._edge_of(parent) / 2
        octant = upper @ np.array([1, 2, 4])
        for number in np.unique(octant).tolist():
            x, y, z = (2 * cell + (number >> axis & 1) for axis, cell in enumerate(parent.cell))
            yield Node(parent.level + 1, (x, y, z), rows[octant == number])

    def _packed(
        self, node: Node, points: NDArray[np.float64], normals: NDArray[np.float32] | None
    ) -> NDArray[np.void]:
        packed = np.empty(len(points), POINT)
        share = (points - self._low_of(node)) / self._edge_of(node)
        packed["at"] = np.clip(np.rint(share * 65535), 0, 65535)
        packed["normal"] = NO_NORMAL if normals is None else octahedral(normals)
        return packed

    def _edge_of(self, node: Node) -> float:
        return self.edge_m / 2**node.level

    def _low_of(self, node: Node) -> NDArray[np.float64]:
        return self.low_m + np.array(node.cell) * self._edge_of(node)


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
