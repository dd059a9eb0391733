"""The change of a map's surface since the version before, and which rays it can concern.

Only cells are known of the surface before: whether each is the same, and the box of what it held. A scan is
the same in both surfaces if each of its rays meets unchanged surface before it enters the box of any changed
cell, of what was there or of what is. So no scan is told to be the same wrongly, and one that only grazes a
box is told to differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from firstfix.native import TriangleTree

from ..execution.stage_cache import StageResult
from ..mesh.places.surface_cells import SurfaceCells, cells_of, rows_in
from ..mesh.tiled_mesh import TiledMesh
from .rays import Rays

MARGIN_M = 0.01  # of boxes and ranges, against rounding
FIRST, AT_ONCE = 4, 32  # origins of a look: most that see the change are told by the first ones
MOST_CELLS = 20_000  # of a larger change no ray is followed
_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ],
    np.uint32,
)  # of a box whose corner k is at the high end of x, y, z by the bits 4, 2, 1 of k


@dataclass(frozen=True)
class ChangedSurface:
    """Cells of the surface that differ between two meshes, and the surface that both have. Thread-safe.

    Attributes:
        before: folder with the ``surface_cells`` of the mesh before, as the stage that chunks read.
        low, high: (k, 3) metres, corners of the boxes of what changed cells hold, before or after.
        boxes: these boxes as surfaces; None: nothing has changed.
        common: the unchanged surface around them; None: there is none.
    """

    before: StageResult
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    boxes: TriangleTree | None
    common: TriangleTree | None

    @classmethod
    def of(cls, before: Path, mesh: Path, reach_m: float) -> Self | None:
        """The change of a mesh; None: so much has changed that no scan would be the same.

        Args:
            before: folder with the surface cells of the mesh before.
            mesh: folder of the finished stage.
            reach_m: no ray is longer.
        """
        old, new = SurfaceCells.load(before), SurfaceCells.load(mesh)
        gone, come = ~rows_in(old.hashed, new.hashed), ~rows_in(new.hashed, old.hashed)
        low = np.concatenate([old.low[gone], new.low[come]]) - MARGIN_M
        high = np.concatenate([old.high[gone], new.high[come]]) + MARGIN_M
        base = StageResult("", before, "")
        if len(low) > MOST_CELLS:
            return None
        if not len(low):
            return cls(base, low.astype(np.float32), high.astype(np.float32), None, None)
        common = _without(new.cell[come], mesh, low.min(axis=0), high.max(axis=0), reach_m)
        return cls(base, low.astype(np.float32), high.astype(np.float32), _boxes(low, high), common)

    def is_met(self, origins: NDArray[np.floating], rays: Rays, reach_m: float, most_m: float) -> bool:
        """Whether a ray from any of (n, 3) origins may meet the change.

        Args:
            rays: from each origin, in the map's directions.
            reach_m: what is further away along x and y does not count.
            most_m: length of the rays.
        """
        if self.boxes is None:
            return False
        at = np.ascontiguousarray(origins, np.float32)
        gap_m = np.maximum(np.maximum(self.low - at.max(axis=0), at.min(axis=0) - self.high), 0)  # (k, 3)
        away_m = np.hypot(gap_m[:, 0], gap_m[:, 1])
        if away_m.min() > reach_m:
            return False
        around = np.flatnonzero(gap_m.max(axis=1) == 0)
        inside = (self.low[around] <= at[:, None]) & (at[:, None] <= self.high[around])
        if inside.all(axis=2).any():  # rays leave the box and enter none
            return True
        nearest = np.argmin(away_m)
        middle = (self.low[nearest] + self.high[nearest]) / 2
        at = at[np.argsort(np.linalg.norm(at - middle, axis=1), kind="stable")]
        level = np.hypot(rays.directions[:, 0], rays.directions[:, 1])
        furthest_m = (reach_m + MARGIN_M) / max(float(level.min()), 1e-3)  # that a ray gets within reach
        most_m = min(most_m, furthest_m)
        starts = [0, *range(FIRST, len(at), AT_ONCE), len(at)]
        return any(
            self._is_met(at[first:last], rays, level, reach_m, most_m)
            for first, last in pairwise(starts)
            if first < last
        )

    def met_by(self, origins: NDArray[np.floating], rays: Rays, most_m: float) -> NDArray[np.bool_]:
        """Whether each ray (n, rays) from (n, 3) origins may meet the change. All do from within a box.

        Args:
            rays: from each origin, in the map's directions.
            most_m: length of the rays.
        """
        at = np.ascontiguousarray(origins, np.float32)
        met = np.zeros((len(at), len(rays)), np.bool_)
        if self.boxes is None:
            return met
        within = self.holds(at)
        met[within] = True
        if within.all():
            return met
        enter_m = self.boxes.ranges(at[~within], rays.directions, rays.order, 0.0, most_m)
        enters = np.isfinite(enter_m)
        some = np.logical_or.reduce(enters, axis=0)
        if self.common is not None and some.any():
            facing = rays.of_rows(some)
            blocked_m = self.common.ranges(at[~within], facing.directions, facing.order, 0.0, most_m)
            enters[:, some] &= enter_m[:, some] <= blocked_m + MARGIN_M
        met[~within] = enters
        return met

    def is_within(self, origins: NDArray[np.floating], reach_m: float) -> bool:
        """Whether a box lies within reach_m of the box of (n, 3) origins, along x and y."""
        gap_m = np.maximum(np.maximum(self.low - origins.max(axis=0), origins.min(axis=0) - self.high), 0)
        return bool((np.hypot(gap_m[:, 0], gap_m[:, 1]) <= reach_m).any())

    def holds(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(n,) which of (n, 3) points lie in a box of what has changed."""
        found = np.zeros(len(points), np.bool_)
        if not len(self.low) or not len(points):
            return found
        rows = np.flatnonzero(_inside(points, self.low.min(axis=0), self.high.max(axis=0)))
        rows = rows[np.argsort(points[rows, 0], kind="stable")]
        at = np.asarray(points[rows], np.float32)
        begin = np.searchsorted(at[:, 0], self.low[:, 0])
        end = np.searchsorted(at[:, 0], self.high[:, 0], "right")
        for low, high, first, last in zip(self.low, self.high, begin.tolist(), end.tolist(), strict=True):
            found[rows[first:last][_inside(at[first:last], low, high)]] = True
        return found

    def _is_met(
        self,
        at: NDArray[np.float32],
        rays: Rays,
        level: NDArray[np.float32],
        reach_m: float,
        most_m: float,
    ) -> bool:
        assert self.boxes is not None
        enter_m = self.boxes.ranges(at, rays.directions, rays.order, 0.0, most_m)  # (k, rays)
        enters = np.isfinite(enter_m)
        enters[enters] = (enter_m * level)[enters] <= reach_m + MARGIN_M
        some = np.logical_or.reduce(enters, axis=0)
        if not some.any() or self.common is None:
            return bool(some.any())
        facing = rays.of_rows(some)
        blocked_m = self.common.ranges(at, facing.directions, facing.order, 0.0, most_m)
        return bool((enters[:, some] & (enter_m[:, some] <= blocked_m + MARGIN_M)).any())


def _inside(
    points: NDArray[np.floating], low: NDArray[np.float32], high: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """(n,) which of (n, 3) points lie between two corners. Column by column, which is quicker."""
    found = np.ones(len(points), np.bool_)
    for column, least, most in zip(points.T, low, high, strict=True):
        found &= (column >= least) & (column <= most)
    return found


def _boxes(low: NDArray[np.float64], high: NDArray[np.float64]) -> TriangleTree:
    """The sides of k boxes with (k, 3) corners as a mesh."""
    number = np.arange(8)
    is_high = np.stack([number & 4, number & 2, number & 1], axis=1) > 0  # (8, 3)
    corners = np.where(is_high[None], high[:, None], low[:, None])  # (k, 8, 3)
    faces = (_FACES[None] + 8 * np.arange(len(low), dtype=np.uint32)[:, None, None]).astype(np.uint32)
    return TriangleTree(
        np.ascontiguousarray(corners.reshape(-1, 3), np.float32),
        np.ascontiguousarray(faces.reshape(-1, 3), np.uint32),
    )


def _without(
    cells: NDArray[np.int64], mesh: Path, low: NDArray[np.float64], high: NDArray[np.float64], reach_m: float
) -> TriangleTree | None:
    """The mesh without the triangles of (k, 4) cells, as far as rays to a box of (3,) corners may meet it."""
    tiled = TiledMesh.load(mesh)
    part = tiled.part(tiled.near(low[:2], high[:2], reach_m))
    kept = part.triangles[~rows_in(cells_of(part.vertices, part.triangles), cells)]
    if not len(kept):
        return None
    return TriangleTree(
        np.ascontiguousarray(part.vertices, np.float32), np.ascontiguousarray(kept, np.uint32)
    )
