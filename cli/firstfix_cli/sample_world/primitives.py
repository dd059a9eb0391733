"""Solids as triangle meshes, built with numpy alone: what the sample worlds are put together from.

All lengths are metres, z is up, and a solid made without a position stands on z = 0 at the origin.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from firstfix.transform import make_transform, rotation_z
from firstfix_builder.mesh.mesh import Mesh

_BOX_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float64)
_BOX_TRIANGLES = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ],
    np.int64,
)  # fmt: skip


class Opening(NamedTuple):
    """A door or window in a wall, in metres along the wall and above its foot."""

    start_m: float
    end_m: float
    sill_m: float
    head_m: float


def transformed(mesh: Mesh, T: NDArray[np.float64]) -> Mesh:
    """Move a mesh by T (4, 4)."""
    return Mesh(mesh.vertices @ T[:3, :3].T + T[:3, 3], mesh.triangles)


def placed(mesh: Mesh, x: float, y: float, z: float = 0.0, yaw_rad: float = 0.0) -> Mesh:
    """Turn a mesh about z, then move it."""
    return transformed(mesh, make_transform(rotation_z(yaw_rad), [x, y, z]))


def block(low: ArrayLike, high: ArrayLike) -> Mesh:
    """The axis-parallel box between two corners."""
    a, b = np.asarray(low, np.float64), np.asarray(high, np.float64)
    return Mesh(a + _BOX_CORNERS * (b - a), _BOX_TRIANGLES)


def box(length: float, width: float, height: float, *, foot: float = 0.0) -> Mesh:
    """Centred on the z axis, its underside at z = foot."""
    return block([-length / 2, -width / 2, foot], [length / 2, width / 2, foot + height])


def frustum(outline: ArrayLike, height: float, *, top: ArrayLike | None = None, foot: float = 0.0) -> Mesh:
    """A convex outline (k, 2), counter-clockwise, drawn up to a top outline of as many corners."""
    below = np.asarray(outline, np.float64)
    above = below if top is None else np.asarray(top, np.float64)
    k = len(below)
    vertices = np.concatenate(
        [
            np.column_stack([below, np.full(k, foot)]),
            np.column_stack([above, np.full(k, foot + height)]),
        ]
    )
    i = np.arange(k)
    j = (i + 1) % k
    fan = np.arange(1, k - 1)
    zero = np.zeros_like(fan)
    triangles = np.concatenate(
        [
            np.column_stack([i, j, j + k]),
            np.column_stack([i, j + k, i + k]),
            np.column_stack([zero, fan + 1, fan]),
            np.column_stack([zero + k, fan + k, fan + 1 + k]),
        ]
    )
    return Mesh(vertices, triangles)


def cylinder(
    radius: float, height: float, *, foot: float = 0.0, sides: int = 12, top_radius: float | None = None
) -> Mesh:
    """Upright, on the z axis; a cone or a tapered trunk with another top radius."""
    angle = np.arange(sides) * 2 * np.pi / sides
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    top = circle * (radius if top_radius is None else top_radius)
    return frustum(circle * radius, height, top=top, foot=foot)


def lying(mesh: Mesh) -> Mesh:
    """Turns parts that stand along z to lie along x."""
    return Mesh(mesh.vertices[:, [2, 0, 1]], mesh.triangles)


def gable(length: float, width: float, height: float, *, underside: bool = True) -> Mesh:
    """A saddle roof on z = 0: ridge along x. Without its underside one looks up into it."""
    a, b = length / 2, width / 2
    corners = [[-a, -b, 0], [a, -b, 0], [a, b, 0], [-a, b, 0], [-a, 0, height], [a, 0, height]]
    triangles = [[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [1, 2, 5], [3, 0, 4]]
    return Mesh(np.array(corners, np.float64), np.array(triangles[0 if underside else 2 :], np.int64))


def blob(radius: float, height: float, rng: np.random.Generator, *, roughness: float = 0.15) -> Mesh:
    """A lumpy ellipsoid on z = 0: crowns of trees, bushes, heaps."""
    rings, sides = 5, 9
    polar = np.linspace(0, np.pi, rings + 2)[1:-1]
    angle = np.arange(sides) * 2 * np.pi / sides
    p, a = np.meshgrid(polar, angle, indexing="ij")
    body = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), -np.cos(p)], axis=-1).reshape(-1, 3)
    body *= 1 + roughness * rng.uniform(-1, 1, (len(body), 1))
    unit = np.concatenate([[[0, 0, -1.0]], body, [[0, 0, 1.0]]])
    i = np.arange(sides)
    j = (i + 1) % sides
    first, last = 1, 1 + (rings - 1) * sides
    faces = [np.column_stack([np.zeros_like(i), first + j, first + i])]
    for ring in range(rings - 1):
        low = first + ring * sides
        faces.append(np.column_stack([low + i, low + j, low + j + sides]))
        faces.append(np.column_stack([low + i, low + j + sides, low + i + sides]))
    faces.append(np.column_stack([last + i, last + j, np.full_like(i, len(unit) - 1)]))
    vertices = unit * [radius, radius, height / 2] + [0, 0, height / 2]
    return Mesh(vertices, np.concatenate(faces))


def height_field(x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]) -> Mesh:
    """Terrain over the grid x (c,), y (r,) with heights z (r, c)."""
    gx, gy = np.meshgrid(x, y)
    vertices = np.column_stack([gx.ravel(), gy.ravel(), z.ravel()])
    corner = (np.arange(len(y) - 1)[:, None] * len(x) + np.arange(len(x) - 1)).ravel()
    right, up = corner + 1, corner + len(x)
    triangles = np.concatenate(
        [np.column_stack([corner, right, up + 1]), np.column_stack([corner, up + 1, up])]
    )
    return Mesh(vertices, triangles)


def wall(
    start: Sequence[float],
    end: Sequence[float],
    height: float,
    *,
    foot: float = 0.0,
    thickness: float = 0.15,
    openings: Iterable[Opening] = (),
) -> Mesh:
    """An upright wall between two (x, y) points, with openings cut out of it."""
    a, b = np.asarray(start, np.float64)[:2], np.asarray(end, np.float64)[:2]
    length = float(np.hypot(*(b - a)))
    half = thickness / 2
    parts = []

    def piece(along0: float, along1: float, low: float, high: float) -> None:
        if along1 - along0 > 1e-6 and high - low > 1e-6:
            parts.append(block([along0, -half, low], [along1, half, high]))

    done = 0.0
    for opening in sorted(openings):
        left, right = max(opening.start_m, done), min(opening.end_m, length)
        piece(done, left, 0, height)
        piece(left, right, 0, opening.sill_m)
        piece(left, right, opening.head_m, height)
        done = max(done, right)
    piece(done, length, 0, height)
    return placed(Mesh.joined(parts), a[0], a[1], foot, float(np.arctan2(*(b - a)[::-1])))
