"""Points on a mesh, evenly: what stands for the map's cloud where the map is a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .clean_cloud import voxel_means
from .mesh import Mesh

MAX_POINTS = 20_000_000


def sample_surface(mesh: Mesh, step_m: float, seed: int = 0) -> NDArray[np.float64]:
    """(n, 3) points about ``step_m`` apart: uniform by area, then one a voxel."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    count = int(min(MAX_POINTS, max(1000, area.sum() * 4 / step_m**2)))
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(area), size=count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    flip = u + v > 1  # fold the square onto the triangle
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    points = a[chosen] + u * (b[chosen] - a[chosen]) + v * (c[chosen] - a[chosen])
    return voxel_means(points, step_m)
