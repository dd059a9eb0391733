"""Which points of a moved scan lie near points of the map, by voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

AT_ONCE = 500_000  # points


class NearMap:
    """Voxels whose centre is near a point of the map.

    Args:
        points: (m, 3) of the map.
        near_m: edge of the voxels, and what is near.
    """

    def __init__(self, points: NDArray[np.float64], near_m: float) -> None:
        self._near_m = near_m
        self._low = points.min(axis=0) - 2 * near_m
        size = np.ceil((points.max(axis=0) + 2 * near_m - self._low) / near_m).astype(int) + 1
        self._is_near = np.zeros(size, np.bool_)
        cells = ((points - self._low) / near_m).astype(int)
        for step in np.ndindex(3, 3, 3):
            shifted = cells + np.array(step) - 1
            centres = self._low + (shifted + 0.5) * near_m
            close = np.linalg.norm(centres - points, axis=1) < near_m
            self._is_near[tuple(shifted[close].T)] = True

    def shares(
        self, points: NDArray[np.float64], rotations: NDArray[np.float64], shifts: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(n, 3) points under (k, 3, 3) rotations and (k, 3) shifts to the (k,) shares that lie near."""
        found = np.zeros(len(rotations))
        last = np.array(self._is_near.shape) - 1
        chunk = max(1, AT_ONCE // len(points))
        in_cells = (points / self._near_m).astype(np.float32).T  # (3, n)
        offsets = ((shifts - self._low) / self._near_m).astype(np.float32)
        turns = rotations.astype(np.float32)
        for begin in range(0, len(found), chunk):
            part = slice(begin, begin + chunk)
            cells = turns[part] @ in_cells + offsets[part, :, None]  # (chunk, 3, n)
            inside = ((cells >= 0) & (cells <= last[:, None])).all(axis=1)
            x, y, z = np.clip(cells, 0, last[:, None]).astype(np.int32).transpose(1, 0, 2)
            found[part] = (self._is_near[x, y, z] & inside).mean(axis=1)
        return found
