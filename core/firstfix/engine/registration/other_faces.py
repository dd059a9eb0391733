"""The other face of a thin wall or slab, for each point of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .surface import Surface

FACES_BACK = -0.5  # cosine: normals further apart belong to two faces
_AXES = 3


def other_faces(surface: Surface, reach_m: float) -> NDArray[np.int32]:
    """Row (n,) of the nearest point within reach that faces the other way, for each point; -1: none.

    Points whose normals may point away from the viewer have no other face, and are none.
    """
    from scipy.spatial import cKDTree  # imported late: a query reads the grids, and makes none

    way = _ways(surface)
    found = np.full(len(surface), -1, np.int32)
    for here in range(2 * _AXES):
        asking = np.flatnonzero(way == here)
        facing_back = np.flatnonzero(way == (here + _AXES) % (2 * _AXES))
        if len(asking) and len(facing_back):
            tree = cKDTree(surface.points[facing_back])
            away_m, nearest = tree.query(surface.points[asking], distance_upper_bound=reach_m)
            near = np.isfinite(away_m)
            found[asking[near]] = facing_back[nearest[near]]
    cosine = np.einsum("ij,ij->i", surface.normals, surface.normals[found])
    found[cosine > FACES_BACK] = -1
    return found


def _ways(surface: Surface) -> NDArray[np.int8]:
    """The main axis (n,) of each normal: 0 to 2 forwards, 3 to 5 backwards, 6: not known which."""
    axis = np.abs(surface.normals).argmax(axis=1)
    backwards = surface.normals[np.arange(len(surface)), axis] < 0
    ways = (axis + _AXES * backwards).astype(np.int8)
    ways[~surface.oriented] = 2 * _AXES
    return ways
