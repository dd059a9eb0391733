"""Upright boxes in a world, as a mesh and as regions of space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import rotation_z

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_TRIANGLES = np.array([t for a, b, c, d in _QUADS for t in ((a, b, c), (a, c, d))])  # (12, 3)


@dataclass(frozen=True)
class Boxes:
    """Upright boxes.

    Attributes:
        centre_m: (n, 3).
        half_m: (n, 3) half of length, width and height.
        yaw: (n,) radians, direction of the length.
    """

    centre_m: NDArray[np.float64]
    half_m: NDArray[np.float64]
    yaw: NDArray[np.float64]

    @classmethod
    def joined(cls, *parts: Boxes) -> Boxes:
        """All boxes of the parts."""
        return cls(*(np.concatenate([getattr(p, n) for p in parts]) for n in ("centre_m", "half_m", "yaw")))

    @classmethod
    def none(cls) -> Boxes:
        """An empty set of boxes."""
        return cls(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))

    def __len__(self) -> int:
        return len(self.yaw)

    def mesh(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """(8 n, 3) vertices and (12 n, 3) triangles."""
        vertices = [
            (_CORNERS * half) @ rotation_z(yaw).T + centre
            for centre, half, yaw in zip(self.centre_m, self.half_m, self.yaw.tolist(), strict=True)
        ]
        triangles = [_TRIANGLES + 8 * i for i in range(len(self))]
        return np.concatenate([np.empty((0, 3)), *vertices]), np.concatenate(
            [np.empty((0, 3), np.int64), *triangles]
        )

    def contain(self, points_m: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Whether each of (p, 3) points lies in a box."""
        inside = np.zeros(len(points_m), bool)
        for centre, half, yaw in zip(self.centre_m, self.half_m, self.yaw.tolist(), strict=True):
            inside |= (np.abs((points_m - centre) @ rotation_z(yaw)) <= half).all(axis=1)
        return inside
