"""Screened Poisson reconstruction of one block of the map; surface without data is cut away.

M. Kazhdan and H. Hoppe, "Screened Poisson surface reconstruction", ACM ToG 32(3), 2013, in Open3D.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .mesh import Mesh
from .orient_normals import estimate_normals, orient_normals


def clip_mesh(mesh: Mesh, axis: int, limit_m: float, keep_below: bool) -> Mesh:
    """The part of the mesh with coordinate <= limit (or >= limit), triangles cut at the plane.

    Args:
        axis: 0, 1 or 2.
        limit_m: coordinate of the plane.
        keep_below: keep the lower side; False: the upper one.
    """
    side = 1.0 if keep_below else -1.0
    depth = (limit_m - mesh.vertices[:, axis]) * side  # >= 0 stays
    inside = (depth >= 0)[mesh.triangles]  # (t, 3)
    count = inside.sum(axis=1)
    whole = mesh.triangles[count == 3]
    one, two = mesh.triangles[count == 1], mesh.triangles[count == 2]
    if len(one) + len(two) == 0:
        return mesh.with_triangles(count == 3)
    # turned so that the odd corner comes first; the winding stays
    one = _corner_first(one, inside[count == 1])
    two = _corner_first(two, ~inside[count == 2])
    start = len(mesh.vertices)
    cut_one = _cuts(mesh.vertices, depth, one)  # (k, 2, 3) on the edges 0-1 and 0-2
    cut_two = _cuts(mesh.vertices, depth, two)
    new = np.concatenate([cut_one.reshape(-1, 3), cut_two.reshape(-1, 3)])
    new[:, axis] = limit_m
    index_one = start + np.arange(2 * len(one)).reshape(-1, 2)
    index_two = start + 2 * len(one) + np.arange(2 * len(two)).reshape(-1, 2)
    triangles = np.concatenate(
        [
            whole,
            np.stack([one[:, 0], index_one[:, 0], index_one[:, 1]], axis=1),
            np.stack([index_two[:, 0], two[:, 1], two[:, 2]], axis=1),
            np.stack([index_two[:, 0], two[:, 2], index_two[:, 1]], axis=1),
        ]
    )
    cut = Mesh(np.concatenate([mesh.vertices, new]), triangles)
    return cut.with_triangles(np.ones(len(triangles), bool))


def _corner_first(triangles: NDArray[np.int64], odd: NDArray[np.bool_]) -> NDArray[np.int64]:
    first = np.argmax(odd, axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    return np.take_along_axis(triangles, order, axis=1)


def _cuts(
    vertices: NDArray[np.float64], depth: NDArray[np.float64], triangles: NDArray[np.int64]
) -> NDArray[np.float64]:
    ends = triangles[:, 1:]  # (k, 2)
    at, to = depth[triangles[:, :1]], depth[ends]
    share = (at / (at - to))[..., None]
    start = vertices[triangles[:, 0]][:, None]
    cuts: NDArray[np.float64] = start + share * (vertices[ends] - start)
    return cuts


MIN_POINTS = 50  # fewer points make no surface


@dataclass(frozen=True)
class Tile:
    """Reconstruction of one block. Picklable, for other processes and machines.

    Attributes:
        points: (n, 3) of the block and its margin.
        places: (m, 3) positions of the scanner, or None.
        low, high: (2,) corners of the block, metres; the result is cut there.
        cell_m: edge of the finest Poisson cell.
        point_weight: weight of the points against smoothness, in the screened Poisson equation.
        trim_m: surface further than this from every point is removed, because it is only interpolated.
        normal_radius_m, normal_neighbours: neighbourhood of a normal.
        sight_voxel_m: resolution of the line-of-sight test that orients the normals.
    """

    points: NDArray[np.float64]
    places: NDArray[np.float64] | None
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    cell_m: float
    point_weight: float
    trim_m: float
    normal_radius_m: float
    normal_neighbours: int
    sight_voxel_m: float


def poisson_tile(tile: Tile) -> Mesh:
    """Surface of a tile, cut at its block. The result is the same on every machine, to the last bit."""
    if len(tile.points) < MIN_POINTS:
        return Mesh.empty()
    normals = estimate_normals(tile.points, tile.normal_radius_m, tile.normal_neighbours)
    normals = orient_normals(tile.points, normals, tile.places, tile.sight_voxel_m)
    surface = poisson_surface(tile.points, normals, tile.cell_m, tile.point_weight)
    mesh = trim_mesh(surface, tile.points, tile.trim_m)
    for axis in (0, 1):
        mesh = clip_mesh(mesh, axis, float(tile.high[axis]), keep_below=True)
        mesh = clip_mesh(mesh, axis, float(tile.low[axis]), keep_below=False)
    return mesh


def poisson_surface(
    points: NDArray[np.float64], normals: NDArray[np.float64], cell_m: float, point_weight: float
) -> Mesh:
    """The closed surface through (n, 3) points with (n, 3) outward normals."""
    from .open3d_core import o3d  # imported late: a provisional version does not wait for it

    # Relative to its centre: the solver has single precision, and a map may lie far from the origin.
    middle = np.round(points.mean(axis=0))
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points - middle))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        # One thread: with more, the order of sums changes, and with it the last bits of the vertices.
        surface, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud,
            depth=0,
            width=cell_m,
            scale=1.1,
            linear_fit=True,
            n_threads=1,
            point_weight=point_weight,
        )
    return Mesh(np.asarray(surface.vertices) + middle, np.asarray(surface.triangles).astype(np.int64))


def trim_mesh(mesh: Mesh, points: NDArray[np.float64], trim_m: float) -> Mesh:
    """Keep the triangles whose corners all have one of the map's (n, 3) points within trim_m."""
    distance, _ = cKDTree(points).query(mesh.vertices, distance_upper_bound=trim_m)
    supported = np.isfinite(distance)
    return mesh.with_triangles(supported[mesh.triangles].all(axis=1))
