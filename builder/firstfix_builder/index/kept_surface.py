"""The surface of a map of which little has changed: that of the version before, but for what has changed.

Points that were seen in the unchanged surface stay with their normals. Those of what has changed are taken
anew, and so are points of unchanged surface that nobody saw before. New points come after all that stay: what
is made of a tile's points is made again only where these differ.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from firstfix.engine.index import MAP_FILE
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface

from ..execution.chunks import Arrays
from ..mesh.clean_cloud import voxel_means
from ..rebuild.base_version import BaseVersion
from ..simulation.changed_surface import ChangedSurface
from .seen_voxels import SeenBlocks, mean_points
from .views import STEP_M
from .visible_points import BORDER_M, SEEN_WITHIN_M

NEWLY_SEEN_M = 0.5  # from all points that stay: nearer ones fill the gaps of what was seen from afar
BESIDE_M = 4.0  # cells about what has changed: surface that it hid is taken up to the points that stay


@dataclass(frozen=True)
class KeptSurface:
    """The surface of the version before, and what has changed since.

    Attributes:
        before: its points and normals.
        change: of the mesh that is looked at.
        seen_from: (n, 3) float32 positions of the templates before, of which its views were taken.
    """

    before: Surface
    change: ChangedSurface
    seen_from: NDArray[np.float32]

    @classmethod
    def load(cls, base: BaseVersion, change: ChangedSurface) -> KeptSurface:
        """The surface of a version."""
        fine = MapSurface.load(base.directory, base.engine.registration).fine
        points = np.load(base.directory / MAP_FILE)
        before = Surface(points, np.array(fine.planes[:, :3]), np.array(fine.oriented))
        return cls(before, change, base.templates.position_m)

    def renewed(
        self, cloud: NDArray[np.floating] | None, views: Iterable[Arrays], voxel_m: float, scratch: Path
    ) -> Surface:
        """The surface now, as ``visible_points.map_surface`` would make it where it has changed.

        Args:
            cloud: (n, 3), or None: the map is a mesh.
            views: results of ``changed_views``.
            scratch: folder for passing files.
        """
        looked = _looked(views, scratch)
        if cloud is None:
            stays, new, toward = self._of_mesh(looked, voxel_m)
        else:
            stays, new, toward = self._of_cloud(looked, cloud, voxel_m)
        rows = np.flatnonzero(stays)
        points = np.concatenate([self.before.points[rows], new])
        normals = np.concatenate([self.before.normals[rows], np.zeros_like(new)])
        oriented = np.concatenate([self.before.oriented[rows], np.zeros(len(new), np.bool_)])
        towards = np.concatenate([normals[: len(rows)] * oriented[: len(rows), None], toward])
        places = np.concatenate([self.before.points[~stays], new])
        away_m = distances(points, places, 2 * BORDER_M)
        around = np.flatnonzero(np.isfinite(away_m))
        if len(around):
            found = Surface.around(points[around], towards[around], two_faces=True)
            there = away_m[around] <= BORDER_M
            normals[around[there]], oriented[around[there]] = found.normals[there], found.oriented[there]
        return Surface(points, normals, oriented)

    def _of_mesh(
        self, looked: NDArray[np.float64], voxel_m: float
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.float32]]:
        """Which points before stay, the new (k, 3) points, and their (k, 3) directions to who sees them."""
        stays = ~self.change.holds(self.before.points)
        thin = (voxel_means(looked, voxel_m) if len(looked) else looked).astype(np.float32)
        points, left = np.ascontiguousarray(thin[:, :3]), self.before.points[stays]
        is_new = self.change.holds(points)
        places = np.concatenate([self.before.points[~stays], points[is_new]])
        beside = ~far_from(points, places, BESIDE_M)
        for rows, apart_m in ((beside & ~is_new, voxel_m), (~beside & ~is_new, NEWLY_SEEN_M)):
            is_new[rows] = far_from(points[rows], left, apart_m)
        return stays, points[is_new], thin[is_new, 3:]

    def _of_cloud(
        self, looked: NDArray[np.float64], cloud: NDArray[np.floating], voxel_m: float
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.float32]]:
        """As ``_of_mesh``, of the points of a cloud."""
        thin = voxel_means(np.asarray(cloud, np.float64), voxel_m).astype(np.float32)
        stays, is_new = _matched(self.before.points, thin, voxel_m)
        new = thin[is_new]
        toward = np.zeros_like(new)
        if len(looked) and len(new):
            away_m, row = cKDTree(looked[:, :3]).query(new, distance_upper_bound=SEEN_WITHIN_M)
            known = np.isfinite(away_m)
            toward[known] = looked[row[known], 3:]
        return stays, new, toward


def _matched(
    before: NDArray[np.float32], now: NDArray[np.float32], voxel_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of (n, 3) points are also among (m, 3) others, one a voxel, and which of these are new."""
    voxels, wanted = (np.floor(one / np.float32(voxel_m)).astype(np.int64) for one in (now, before))
    low = np.minimum(voxels.min(axis=0), wanted.min(axis=0))
    shape = tuple(np.maximum(voxels.max(axis=0), wanted.max(axis=0)) - low + 1)
    number = np.ravel_multi_index(tuple((voxels - low).T), shape)
    order = np.argsort(number, kind="stable")  # quick: they nearly are in order
    at = np.searchsorted(number[order], np.ravel_multi_index(tuple((wanted - low).T), shape))
    row = order[np.minimum(at, len(order) - 1)]
    there = now[row]
    stays = (there[:, 0] == before[:, 0]) & (there[:, 1] == before[:, 1]) & (there[:, 2] == before[:, 2])
    is_new = np.ones(len(now), np.bool_)
    is_new[row[stays]] = False
    return stays, is_new


def _looked(views: Iterable[Arrays], scratch: Path) -> NDArray[np.float64]:
    """(m, 6) points and directions of what is seen."""
    with TemporaryDirectory(dir=scratch) as folder:
        seen = SeenBlocks(Path(folder), STEP_M)
        for part in views:
            seen.add(part["voxels"])
        blocks = (mean_points(seen.voxels(block), STEP_M) for block in sorted(seen.blocks))
        return np.concatenate([np.zeros((0, 6)), *blocks])


def distances(
    points: NDArray[np.float32], places: NDArray[np.float32], reach_m: float
) -> NDArray[np.float64]:
    """(n,) metres from (n, 3) points to the nearest of (k, 3) places; inf beyond reach_m."""
    found = np.full(len(points), np.inf)
    if not len(places):
        return found
    columns = np.floor(places[:, :2] / reach_m).astype(np.int64)
    low = columns.min(axis=0) - 1
    marked = np.zeros(columns.max(axis=0) - low + 2, np.bool_)
    marked[tuple((columns - low).T)] = True
    marked = binary_dilation(marked, np.ones((3, 3), np.bool_))
    x, y = (np.floor(points[:, axis] / reach_m).astype(np.int64) - low[axis] for axis in (0, 1))
    inside = (x >= 0) & (x < marked.shape[0]) & (y >= 0) & (y < marked.shape[1])
    rows = np.flatnonzero(inside)
    rows = rows[marked[x[rows], y[rows]]]
    found[rows] = cKDTree(places).query(points[rows], distance_upper_bound=reach_m)[0]
    return found


def far_from(points: NDArray[np.float32], others: NDArray[np.float32], cell_m: float) -> NDArray[np.bool_]:
    """(n,) which of (n, 3) points have none of (k, 3) others in their cubic cell or one beside it."""
    found = np.ones(len(points), np.bool_)
    if not len(points) or not len(others):
        return found
    cell, filled = (np.floor(one / cell_m).astype(np.int64) for one in (points, others))
    low = np.minimum(cell.min(axis=0), filled.min(axis=0)) - 1
    shape = np.maximum(cell.max(axis=0), filled.max(axis=0)) - low + 2
    known = np.unique(np.ravel_multi_index(tuple((filled - low).T), tuple(shape)))
    steps = sorted(product((-1, 0, 1), repeat=3), key=np.linalg.norm)  # its own first: it decides of most
    for step in steps:
        rows = np.flatnonzero(found)
        number = np.ravel_multi_index(tuple((cell[rows] + np.array(step) - low).T), tuple(shape))
        at = np.minimum(np.searchsorted(known, number), len(known) - 1)
        found[rows[known[at] == number]] = False
    return found
