"""The other face of a thin wall or slab, for each point of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .surface import Surface

PART = 1 << 20  # points at once
FACES_BACK = -0.5  # cosine: normals further apart belong to two faces
_AXES = 3


def other_faces(surface: Surface, reach_m: float) -> NDArray[np.int32]:
    """Row (n,) of the nearest point within reach that faces the other way, for each point; -1: none.

    Points whose normals may point away from the viewer have no other face, and are none.
    """
    from scipy.spatial import cKDTree  # imported late: a query reads the grids, and makes none

    way = _ways(surface)
    found = np.full(len(surface), -1, np.int32)
    order = np.argsort(surface.points[:, 0], kind="stable").astype(np.int32)
    x = surface.points[order, 0].astype(np.float64)
    for start in range(0, len(order), PART):
        rows = order[start : start + PART]
        last = start + len(rows) - 1
        around = order[slice(*np.searchsorted(x, [x[start] - reach_m, x[last] + reach_m]))]
        for here in range(2 * _AXES):
            asking = rows[way[rows] == here]
            facing_back = around[way[around] == (here + _AXES) % (2 * _AXES)]
            if len(asking) and len(facing_back):
                tree = cKDTree(surface.points[facing_back])
                away_m, nearest = tree.query(surface.points[asking], distance_upper_bound=reach_m)
                near = np.isfinite(away_m)
                found[asking[near]] = facing_back[nearest[near]]
    for start in range(0, len(found), PART):
        part = slice(start, start + PART)
        cosine = np.einsum("ij,ij->i", surface.normals[part], surface.normals[found[part]])
        found[part][cosine > FACES_BACK] = -1
    return found


def _ways(surface: Surface) -> NDArray[np.int8]:
    """The main axis (n,) of each normal: 0 to 2 forwards, 3 to 5 backwards, 6: not known which."""
    ways = np.full(len(surface), 2 * _AXES, np.int8)
    for start in range(0, len(surface), PART):
        normals = surface.normals[start : start + PART]
        axis = np.abs(normals).argmax(axis=1)
        backwards = normals[np.arange(len(normals)), axis] < 0
        ways[start : start + PART] = axis + _AXES * backwards
    ways[~surface.oriented] = 2 * _AXES
    return ways
