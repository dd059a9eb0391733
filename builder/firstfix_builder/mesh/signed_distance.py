"""One block of the map as a surface: where the signed distance from the planes of its cells is zero.

The signed distance of a place is the mean over the planes around it, weighted by nearness (H. Hoppe et al.,
"Surface reconstruction from unorganized points", SIGGRAPH 1992). Surface nets (S. F. Gibson, 1998) make
the triangles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.errors import BuildFailed
from firstfix.native import cell_planes, surface_net

from .blocks import Block
from .mesh import Mesh
from .orient_normals import orient_normals

EDGE_CELLS = 3.0  # points around a cell at the straight edge of a surface, by the tent of cell_planes
REACH_CELLS = 2.0  # less leaves holes at the foot of walls and between sparse rings, more rounds corners
MOST_TRIM_CELLS = 4.0


def signed_distance_mesh(
    points: NDArray[np.float64],
    places: NDArray[np.float64] | None,
    block: Block,
    *,
    cell_m: float,
    spacing_m: float,
    usual_range_m: float,
    trim_m: float,
    sight_voxel_m: float,
) -> Mesh:
    """The surface through (n, 3) points of a block and its margin: triangles with their middle in the block.

    The cells have corners at multiples of their edge, so neighbours make the same triangles at their border.

    Args:
        points: metres.
        places: (m, 3) where the scanner was, or None.
        block: what the result answers for.
        cell_m: edge of a cell.
        spacing_m: between the cloud's points.
        usual_range_m: from the cloud's points to the nearest place, the median over the cloud.
        trim_m: surface further than this from the points goes.
        sight_voxel_m: grain of the line-of-sight test that orients the normals.

    Raises:
        BuildFailed: a point is over a million cells away from the origin.
    """
    try:
        means, normals, weights, supports = cell_planes(points, cell_m)
        if places is not None and len(places):
            dense = supports >= least_support(means, places, cell_m / spacing_m, usual_range_m)
            means, normals, weights = means[dense], normals[dense], weights[dense]
        if len(means) == 0:
            return Mesh.empty()
        normals = orient_normals(means, normals, places, sight_voxel_m)
        trim_cells = min(trim_m / cell_m, MOST_TRIM_CELLS)
        vertices, triangles = surface_net(means, normals, weights, cell_m, REACH_CELLS, trim_cells)
    except ValueError as error:
        raise BuildFailed(f"no surface of cells of {cell_m:.3g} m: {error}") from None
    middle = vertices[triangles].mean(axis=1)
    return Mesh(vertices, triangles.astype(np.int64)).with_triangles(block.holds(middle))


def least_support(
    means: NDArray[np.float64], places: NDArray[np.float64], cell_spacings: float, usual_range_m: float
) -> NDArray[np.float64]:
    """The (n,) supports that cells need: those at the edge of a surface that was sampled from the nearest place.

    Rays spread, so a surface has the fewer points the further the scanner stayed away, as one over the square.
    One that is nearer than usual has at least the usual density. What is thinner is no surface: returns from
    passers-by, from dust, and from the robot.
    """
    range_m, _ = cKDTree(places).query(means)
    sampled = np.minimum(1.0, (usual_range_m / np.maximum(range_m, 1e-9)) ** 2)
    needed: NDArray[np.float64] = EDGE_CELLS * cell_spacings**2 * sampled
    return needed
