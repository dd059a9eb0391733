"""Meshes of boxes and slopes, made by hand so that every expectation is exact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix_builder.mesh.mesh import Mesh

_FACES = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
        *([2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
    ]
)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A closed box, faces outwards."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    return Mesh(np.array(low) + corners * (np.array(high) - np.array(low)), _FACES.astype(np.int64))


def quad(*corners: tuple[float, float, float]) -> Mesh:
    return Mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]]))


def floor(x0: float, y0: float, x1: float, y1: float, z: float = 0.0) -> Mesh:
    return quad((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))


def walls(x0: float, y0: float, x1: float, y1: float, height: float = 3.0) -> list[Mesh]:
    """Four closed walls, 0.1 m thick, around a rectangle."""
    t = 0.1
    return [
        box((x0 - t, y0 - t, -0.1), (x1 + t, y0, height)),
        box((x0 - t, y1, -0.1), (x1 + t, y1 + t, height)),
        box((x0 - t, y0, -0.1), (x0, y1, height)),
        box((x1, y0, -0.1), (x1 + t, y1, height)),
    ]


def sampled(mesh: Mesh, per_m2: float, seed: int = 0) -> NDArray[np.float64]:
    """(n, 3) random points on the surface."""
    rng = np.random.default_rng(seed)
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    number = rng.choice(len(area), int(per_m2 * area.sum()), p=area / area.sum())
    u, v = rng.random((2, len(number), 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    return a[number] + u * (b - a)[number] + v * (c - a)[number]
