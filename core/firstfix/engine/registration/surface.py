"""Surface: points with normals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...scan.reduction import rows_by_voxel_hash
from ...transform import Matrix
from .tile_rows import cells_a_tile, columns_of, tile_rows

SAME_FRAME = np.eye(4)


@dataclass(frozen=True)
class Surface:
    """Points with normals.

    Attributes:
        points: (n, 3) float32 metres.
        normals: (n, 3) float32, unit.
        oriented: (n,) whether the normal is known to point towards the viewer. A wall has two faces, and a
            scan of one must not be aligned with the other.
        time_s: (n,) float32, when a scan's points were taken, in seconds from its stamp; None: not known, or
            a map.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    oriented: NDArray[np.bool_]
    time_s: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def around(
        cls,
        points: NDArray[np.floating],
        to_viewer: NDArray[np.floating] | None = None,
        two_faces: bool = False,
    ) -> Surface:
        """Surface of points, with normals estimated from each point's ten nearest (itself among them).

        Args:
            points: (n, 3) finite metres.
            to_viewer: (n, 3) directions of any length, 0 if unknown.
            two_faces: points lie on both faces of walls and slabs, as a map's do. Those seen from opposite
                sides then count as four times as far apart as they are.
        """
        single = np.ascontiguousarray(points, np.float32)
        toward = None if to_viewer is None else np.ascontiguousarray(to_viewer, np.float32)
        normals, oriented = native.surface_normals(single, toward, two_faces)
        return cls(single, normals, oriented.view(np.bool_))

    def at(self, rows: NDArray[np.integer] | NDArray[np.bool_] | slice) -> Surface:
        """Surface of the given rows."""
        if isinstance(rows, slice) or rows.dtype == np.bool_:
            time_s = None if self.time_s is None else self.time_s[rows]
            return Surface(self.points[rows], self.normals[rows], self.oriented[rows], time_s)
        # take copies a point at once, indexing number by number
        time_s = None if self.time_s is None else self.time_s.take(rows)
        points, normals = self.points.take(rows, axis=0), self.normals.take(rows, axis=0)
        return Surface(points, normals, self.oriented.take(rows), time_s)

    def at_most(self, count: int, voxel_m: float) -> Surface:
        """Surface of at most ``count`` of the points (``rows_by_voxel_hash``)."""
        return self if len(self) <= count else self.at(rows_by_voxel_hash(self.points, voxel_m, count))

    def moved(self, T: Matrix) -> Surface:
        """Surface brought from the right frame of T to its left frame."""
        if np.array_equal(T, SAME_FRAME):  # as the only scan of a query
            return self
        R = T[:3, :3].astype(np.float32)
        points = self.points @ R.T + T[:3, 3].astype(np.float32)
        return Surface(points, self.normals @ R.T, self.oriented, self.time_s)

    def deskewed(self, twist: NDArray[np.float64] | None) -> Surface:
        """Surface of a scan as it would have been seen at its stamp. None, or no times, changes nothing.

        Args:
            twist: (6,) m/s then rad/s, in the sensor frame.
        """
        if twist is None or self.time_s is None:
            return self
        turn = np.concatenate([np.zeros(3), twist[3:]])
        return replace(
            self,
            points=native.deskew(self.points, self.time_s, twist),
            normals=native.deskew(self.normals, self.time_s, turn),
        )

    def thinned(self, voxel_m: float) -> Surface:
        """Surface of the mean point of every voxel, one for each main direction of its normals.

        Tile by tile, which takes little memory.
        """
        if not len(self):
            return self
        tiles = tile_rows(columns_of(self.points, voxel_m), cells_a_tile(voxel_m))
        return Surface.together([self.at(one.rows)._thinned(voxel_m) for one in tiles])

    def _thinned(self, voxel_m: float) -> Surface:
        points, normals, oriented = native.thin_surface(self.points, self.normals, self.oriented, voxel_m)
        return Surface(points, normals, oriented.view(np.bool_))

    @classmethod
    def gathered(cls, parts: Iterable[Surface], count: int) -> Surface:
        """Surface of all points of several surfaces without times, of which one at a time is in memory.

        Args:
            count: number of all points.
        """
        points, normals = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
        oriented = np.empty(count, np.bool_)
        first = 0
        for part in parts:
            rows = slice(first, first + len(part))
            points[rows], normals[rows], oriented[rows] = part.points, part.normals, part.oriented
            first = rows.stop
        return cls(points, normals, oriented)

    @classmethod
    def together(cls, parts: Sequence[Surface]) -> Surface:
        """Surface of all points of several surfaces. Where one has times, the others are taken at time 0."""
        if len(parts) == 1:
            return parts[0]
        time_s = None
        if any(part.time_s is not None for part in parts):
            still = (
                np.zeros(len(part), np.float32) if part.time_s is None else part.time_s for part in parts
            )
            time_s = np.concatenate(list(still))
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.oriented for part in parts]),
            time_s,
        )
