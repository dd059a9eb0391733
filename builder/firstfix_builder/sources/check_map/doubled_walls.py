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
from firstfix.transform import inverse, transform_points

from .own_axes import own_axes
from .surfaces import surfaces
from .told_places import in_words, marked

VOXEL_M = 0.1
MAX_POINTS = 400_000
APART_M = tuple(0.25 + 0.1 * k for k in range(5))  # thicker than a wall, nearer than the next one
MAX_APART_M = 0.65
PLACE_M = 8.0
DOUBLED_SHARE = 0.1  # of all walls: garden walls that are seen from both sides are up to 0.09 of a street
MIN_PLACES = 3
_SAMPLED_WALLS = 9_000
_MIN_WALLS = 200  # fewer say nothing
_UPRIGHT_COSINE, _PARALLEL_COSINE = 0.26, 0.95
_NEIGHBOURS, _MIN_PARALLEL, _PLANE_M = 20, 0.8, 0.04
_MIN_IN_PLACE, _MIN_PAIRED, _SAME_M, _MIN_SAME = 20, 0.6, 0.1, 0.7
_ALONG_COSINE = float(np.cos(np.radians(22.5)))
_SAMPLED_CENTRES = 1_500
_SEED = 34


def check_doubled_walls(points: NDArray[np.float64], origin: NDArray[np.float64]) -> Finding | None:
    """Finding of a map in which walls have parallel twins, with the places.

    It looks along the map's own axes: how the map is turned in its frame does not matter.

    Args:
        points: (n, 3) with z up.
        origin: (3,) what brings their coordinates to those of the file.
    """
    T_own_map = own_axes(points)
    surface = surfaces(transform_points(T_own_map, points), VOXEL_M, MAX_POINTS)
    tree = cKDTree(surface.points, balanced_tree=False, compact_nodes=False)  # asked little, so made quickly
    walls = _plane_walls(surface, tree)
    if len(walls) < _MIN_WALLS:
        return None
    apart_m = _twin_distances(surface, tree, walls)
    own, normals = surface.points[walls].astype(np.float64), surface.normals[walls].astype(np.float64)
    centre = np.random.default_rng(_SEED).permutation(len(walls))[:_SAMPLED_CENTRES]
    twin_m = _agreed_distances(own, normals, apart_m, centre)
    doubled = np.isfinite(twin_m)
    share = float(doubled.mean())
    at = own[centre[doubled]]
    _, first, count = np.unique(
        np.floor(at[:, :2] / PLACE_M).astype(np.int64), axis=0, return_index=True, return_counts=True
    )
    if len(first) < MIN_PLACES or share < DOUBLED_SHARE:
        return None
    told = marked(transform_points(inverse(T_own_map), at[first[np.argsort(-count)]]), origin)
    numbers = {"doubled_share": share, "apart_m": float(np.mean(twin_m[doubled])), "count": len(first)}
    return MAP_DOUBLED_WALLS.found(numbers, near=in_words(told)).at(told)


def _agreed_distances(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    apart_m: NDArray[np.float64],
    centre: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Distance (c,) of the twins around each of some wall points (n, 3); infinite: they do not agree on one.

    Around a centre is the wall within half of PLACE_M that runs as the wall does there.

    Args:
        apart_m: (n,) of each wall point's twin, see ``_twin_distances``.
        centre: (c,) rows of the points.
    """
    near = cKDTree(points[:, :2]).query_ball_point(points[centre, :2], PLACE_M / 2)
    of = np.repeat(np.arange(len(centre)), list(map(len, near)))
    row = np.concatenate([np.asarray(one, np.intp) for one in near])
    along = np.abs(np.einsum("ij,ij->i", normals[row], normals[centre[of]])) > _ALONG_COSINE
    of, row = of[along], row[along]
    members = np.bincount(of, minlength=len(centre))
    paired = np.isfinite(apart_m[row])
    of, twin_m = of[paired], apart_m[row[paired]]
    order = np.lexsort((twin_m, of))
    of, twin_m = of[order], twin_m[order]
    pairs = np.bincount(of, minlength=len(centre))
    middle_m = np.full(len(centre), np.inf)
    some = pairs > 0
    middle_m[some] = twin_m[(np.cumsum(pairs) - pairs + pairs // 2)[some]]
    same = np.bincount(of[np.abs(twin_m - middle_m[of]) < _SAME_M], minlength=len(centre))
    agreed = (members >= _MIN_IN_PLACE) & (pairs >= _MIN_PAIRED * members) & (same > _MIN_SAME * pairs)
    return np.where(agreed & (middle_m <= MAX_APART_M), middle_m, np.inf)


def _plane_walls(surface: Surface, tree: cKDTree) -> NDArray[np.intp]:
    """Rows of points on upright planes, of a sample."""
    upright = np.flatnonzero(np.abs(surface.normals[:, 2]) < _UPRIGHT_COSINE)
    if len(upright) < _MIN_WALLS:
        return upright[:0]
    rng = np.random.default_rng(_SEED)
    rows = rng.choice(upright, min(_SAMPLED_WALLS, len(upright)), replace=False)
    _, around = tree.query(surface.points[rows], _NEIGHBOURS)
    normal = surface.normals[rows]
    parallel = np.abs(np.einsum("ijk,ik->ij", surface.normals[around], normal)) > _PARALLEL_COSINE
    offset_m = np.abs(np.einsum("ijk,ik->ij", surface.points[around] - surface.points[rows][:, None], normal))
    is_plane = (parallel.mean(axis=1) > _MIN_PARALLEL) & (offset_m.mean(axis=1) < _PLANE_M)
    return rows[is_plane]


def _twin_distances(surface: Surface, tree: cKDTree, walls: NDArray[np.intp]) -> NDArray[np.float64]:
    """Distance (k,) of each wall point's nearest parallel twin across an empty gap; infinite without one."""
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
