"""Points of many scans joined in voxels while they come: the memory follows the place, not the scans."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData

from .map_limits import LIMITS

FIRST_FOLD_ROWS = 500_000
FOLD_SHARE = 0.25  # of the rows that are joined already
VOXEL_GROWTH = 1.25
_COLUMNS = 4  # without an intensity
MAX_VOXELS = 2.0**62  # between the outermost points: their numbers are 64-bit integers


class JoinedCloud:
    """Of each voxel the mean of all points that fell into it, with their intensity where all scans have one.

    Attributes:
        voxel_m: edge of a voxel; it grows when the cloud would have too many points.
    """

    def __init__(self, voxel_m: float, max_points: int) -> None:
        self.voxel_m = voxel_m
        self._max_points = max_points
        self._rows = np.empty((0, 5))  # x y z and intensity of the mean, and the number of points
        self._fresh: list[NDArray[np.float64]] = []

    def add(self, points: NDArray[np.float64], intensity: NDArray[np.floating] | None = None) -> None:
        """Join (n, 3) points, metres, with their (n,) intensity.

        Raises:
            MalformedData: the scans lie thousands of kilometres apart.
            TooLarge, UnfitMap: the cloud is beyond the limits of a map.
        """
        if intensity is None and self._rows.shape[1] > _COLUMNS:
            self._rows, *self._fresh = (np.delete(one, 3, axis=1) for one in (self._rows, *self._fresh))
        told = [intensity] if intensity is not None and self._rows.shape[1] > _COLUMNS else []
        self._fresh.append(_joined(np.column_stack([points, *told, np.ones(len(points))]), self.voxel_m))
        if sum(map(len, self._fresh)) > max(FIRST_FOLD_ROWS, FOLD_SHARE * len(self._rows)):
            self._fold()

    def points(self) -> NDArray[np.float64]:
        """(m, 3) the cloud so far, in x-y-z order of the voxels; raises as ``add`` does."""
        self._fold()
        return self._rows[:, :3]

    def intensity(self) -> NDArray[np.float64] | None:
        """(m,) mean intensity of the ``points``; None: a scan has none. Raises as ``add`` does."""
        self._fold()
        return self._rows[:, 3] if self._rows.shape[1] > _COLUMNS else None

    def _fold(self) -> None:
        rows = np.concatenate([self._rows, *self._fresh])
        self._fresh = []
        LIMITS.check("mapping scans", len(rows), rows.itemsize * rows.shape[1])
        self._rows = _joined(rows, self.voxel_m)
        while len(self._rows) > self._max_points:
            self.voxel_m *= VOXEL_GROWTH
            self._rows = _joined(self._rows, self.voxel_m)


def _joined(rows: NDArray[np.float64], voxel_m: float) -> NDArray[np.float64]:
    """Means of the (n, 4 or 5) rows of each voxel, weighted by the last column, which is added up."""
    if not len(rows):
        return rows
    key = _voxel_of(rows[:, :3], voxel_m)
    order = np.argsort(key, kind="stable")  # quick: what was joined before is in order
    key, rows = key[order], rows[order]
    first = np.flatnonzero(np.append(True, key[1:] != key[:-1]))
    number = np.add.reduceat(rows[:, -1], first)
    summed = np.add.reduceat(rows[:, :-1] * rows[:, -1:], first)
    return np.column_stack([summed / number[:, None], number])


def _voxel_of(points: NDArray[np.float64], voxel_m: float) -> NDArray[np.int64]:
    """(n,) number of each point's voxel, in x-y-z order."""
    cell = np.floor(points / voxel_m).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    if np.prod(size.astype(np.float64)) > MAX_VOXELS:
        raise MalformedData("the scans lie too far apart for one map: is a pose wrong?")
    return (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
