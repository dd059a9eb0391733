"""Cuts a mesh along axis-aligned planes, so that tiles meet without a gap or an overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .mesh import Mesh


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
