"""Walls that are in a map twice: a loop of the mapping run was not closed.

The two faces of a thin wall and the sides of a pillar are twins, too. What tells a loop is that most of the
wall of one place and direction has a twin at one and the same distance, with nothing between, and that there
are several such places.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.registration.surface import Surface
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_DOUBLED_WALLS

from .told_places import in_words, marked

VOXEL_M = 0.1
MAX_POINTS = 400_000
APART_M = tuple(0.25 + 0.1 * k for k in range(5))  # thicker than a wall, nearer than the next one
MAX_APART_M = 0.65
PLACE_M = 8.0
DOUBLED_SHARE = 0.1  # of all walls
MIN_PLACES = 3
_SAMPLED_WALLS = 9_000
_MIN_WALLS = 200  # fewer say nothing
_UPRIGHT_COSINE, _PARALLEL_COSINE = 0.26, 0.95
_NEIGHBOURS, _MIN_PARALLEL, _PLANE_M = 20, 0.8, 0.04
_MIN_IN_PLACE, _MAX_OF_PLACE, _SAME_M, _MIN_SAME = 20, 0.6, 0.1, 0.7
_DIRECTIONS = 4
_SEED = 34


def check_doubled_walls(surface: Surface, origin: NDArray[np.float64]) -> Finding | None:
    """Finding of a map in which walls have parallel twins, with the places.

    Args:
        surface: points VOXEL_M apart.
        origin: (3,) what brings its coordinates to those of the file.
    """
    walls = _plane_walls(surface)
    if len(walls) < _MIN_WALLS:
        return None
    apart_m = _twin_distances(surface, walls)
    points, normals = surface.points[walls], surface.normals[walls]
    cell = np.floor(points[:, :2] / PLACE_M).astype(np.int64)
    turn = np.arctan2(normals[:, 1], normals[:, 0]) % np.pi
    direction = np.round(turn / (np.pi / _DIRECTIONS)).astype(np.int64) % _DIRECTIONS
    _, place = np.unique(np.column_stack([cell, direction]), axis=0, return_inverse=True)
    twins: list[NDArray[np.intp]] = []
    for number in range(place.max() + 1):
        members = np.flatnonzero(place == number)
        paired = members[np.isfinite(apart_m[members])]
        if len(members) < _MIN_IN_PLACE or len(paired) < _MAX_OF_PLACE * len(members):
            continue
        middle_m = np.median(apart_m[paired])
        if middle_m <= MAX_APART_M and np.mean(np.abs(apart_m[paired] - middle_m) < _SAME_M) > _MIN_SAME:
            twins.append(paired)
    share = sum(map(len, twins)) / len(walls)
    if len(twins) < MIN_PLACES or share < DOUBLED_SHARE:
        return None
    centres = np.array([points[one].mean(axis=0) for one in sorted(twins, key=len, reverse=True)])
    told = marked(centres, origin)
    numbers = {
        "doubled_share": share,
        "apart_m": float(np.mean(apart_m[np.concatenate(twins)])),
        "count": len(twins),
    }
    return MAP_DOUBLED_WALLS.found(numbers, near=in_words(told)).at(told)


def _plane_walls(surface: Surface) -> NDArray[np.intp]:
    """Rows of points on upright planes, of a sample."""
    upright = np.flatnonzero(np.abs(surface.normals[:, 2]) < _UPRIGHT_COSINE)
    if len(upright) < _MIN_WALLS:
        return upright[:0]
    rng = np.random.default_rng(_SEED)
    rows = rng.choice(upright, min(_SAMPLED_WALLS, len(upright)), replace=False)
    _, around = cKDTree(surface.points).query(surface.points[rows], _NEIGHBOURS)
    normal = surface.normals[rows]
    parallel = np.abs(np.einsum("ijk,ik->ij", surface.normals[around], normal)) > _PARALLEL_COSINE
    offset_m = np.abs(np.einsum("ijk,ik->ij", surface.points[around] - surface.points[rows][:, None], normal))
    is_plane = (parallel.mean(axis=1) > _MIN_PARALLEL) & (offset_m.mean(axis=1) < _PLANE_M)
    return rows[is_plane]


def _twin_distances(surface: Surface, walls: NDArray[np.intp]) -> NDArray[np.float64]:
    """Distance (k,) of each wall point's nearest parallel twin across an empty gap; infinite without one."""
    tree = cKDTree(surface.points)
    points, normals = surface.points[walls].astype(np.float64), surface.normals[walls].astype(np.float64)
    found = np.full(len(walls), np.inf)
    for apart_m in APART_M:
        for side in (-1.0, 1.0):
            near_m, row = tree.query(points + side * apart_m * normals, distance_upper_bound=VOXEL_M)
            row = np.where(np.isfinite(near_m), row, 0)
            is_twin = np.isfinite(near_m)
            is_twin &= np.abs(np.einsum("ij,ij->i", surface.normals[row], normals)) > _PARALLEL_COSINE
            gap_m, _ = tree.query(points + side * apart_m / 2 * normals)
            is_twin &= gap_m > min(VOXEL_M, 0.45 * apart_m)
            across_m = np.abs(np.einsum("ij,ij->i", surface.points[row] - points, normals))
            found = np.where(is_twin & (across_m < found), across_m, found)
    return found
