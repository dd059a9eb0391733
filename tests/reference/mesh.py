"""Surfaces of clouds in NumPy: the kernels of ``firstfix.native`` are held against them."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

Cell = tuple[int, int, int]

AROUND = np.array(list(product((-1, 0, 1), repeat=3)))
CORNERS = np.array(list(product((0, 1), repeat=3)))
EDGES = [(low, high) for low in range(8) for high in range(8) if (CORNERS[high] - CORNERS[low] >= 0).all()
         and (CORNERS[high] - CORNERS[low]).sum() == 1]  # fmt: skip


def cell_planes(points: NDArray[np.float64], cell_m: float) -> tuple[NDArray[np.float64], ...]:
    """Columns of cells: means, normals, weights, supports, best supports around, variances along the axes."""
    cell, row = np.unique(np.floor(points / cell_m).astype(int), axis=0, return_inverse=True)
    row = row.ravel()
    first = np.unique(row, return_index=True)[1]
    away = np.abs(cell[:, None] - cell[row])  # of each point from each cell
    tent = np.where((away <= 1).all(axis=2), 0.5 ** away.sum(axis=2), 0)
    around = (np.abs(cell[:, None] - cell) <= 1).all(axis=2)
    best = np.where(around, tent.sum(axis=1), 0).max(axis=1)
    rows = []
    for number in np.argsort(first):
        off = np.abs(cell[row] - cell[number])
        near = (off <= 1).all(axis=1)
        if near.sum() < 3:
            continue
        weight = 0.5 ** off[near].sum(axis=1)
        away = points[near] - np.average(points[near], axis=0, weights=weight)
        variance, axes = np.linalg.eigh((weight * away.T) @ away / weight.sum())
        own = points[row == number]
        rows.append((own.mean(axis=0), axes[:, 0], float(len(own)), weight.sum(), best[number], variance))
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def surface_net(
    means: NDArray[np.float64],
    normals: NDArray[np.float64],
    weights: NDArray[np.float64],
    near: NDArray[np.float64],
    cell_m: float,
    reach_cells: float,
    trim_cells: float,
) -> tuple[dict[Cell, NDArray[np.float64]], list[tuple[Cell, Cell, Cell, Cell]]]:
    """The vertex of each cell that has one, and the quadrangles, each counter-clockwise from free space."""

    def distance(corner: NDArray[np.int64]) -> float | None:
        off = corner * cell_m - means
        far = (off**2).sum(axis=1) / (reach_cells * cell_m) ** 2
        nearness = np.where(far < 1, (1 - far) ** 2, 0) * weights
        if nearness.sum() == 0:
            return None
        return float((nearness * (normals * off).sum(axis=1)).sum() / nearness.sum())

    vertices: dict[Cell, NDArray[np.float64]] = {}
    for cell in np.unique((np.floor(near / cell_m).astype(int)[:, None] + AROUND).reshape(-1, 3), axis=0):
        at = [distance(cell + corner) for corner in CORNERS]
        if None in at:
            continue
        crossings = [
            CORNERS[low] + (CORNERS[high] - CORNERS[low]) * at[low] / (at[low] - at[high])
            for low, high in EDGES
            if (at[low] < 0) != (at[high] < 0)
        ]
        if crossings:
            vertex = (cell + np.mean(crossings, axis=0)) * cell_m
            if np.linalg.norm(near - vertex, axis=1).min() <= trim_cells * cell_m:
                vertices[tuple(cell.tolist())] = vertex
    quadrangles = []
    for cell in vertices:
        for axis in range(3):
            step = np.eye(3, dtype=int)
            below, above = distance(np.array(cell)), distance(np.array(cell) + step[axis])
            if below is None or above is None or (below < 0) == (above < 0):
                continue
            u, v = step[(axis + 1) % 3], step[(axis + 2) % 3]
            ring = [tuple((np.array(cell) - back).tolist()) for back in (0 * u, u, u + v, v)]
            if all(corner in vertices for corner in ring):
                quadrangles.append(tuple(ring if below < 0 else ring[::-1]))
    return vertices, quadrangles


def in_sight(
    occupied: NDArray[np.uint8],
    low: NDArray[np.int64],
    voxel_m: float,
    points: NDArray[np.float64],
    outwards: NDArray[np.float64],
    places: NDArray[np.float64],
    start_voxels: float,
    steps: int,
) -> NDArray[np.uint8]:
    """Whether nothing near each point hides it from its place."""

    def is_occupied(at: NDArray[np.float64]) -> NDArray[np.bool_]:
        cell = np.floor(at / voxel_m).astype(np.int64) - low
        inside = ((cell >= 0) & (cell < occupied.shape)).all(axis=1)
        hit = np.zeros(len(at), bool)
        hit[inside] = occupied[tuple(cell[inside].T)]
        return hit

    start = points + outwards * (start_voxels * voxel_m)
    ray = places - start
    length = np.linalg.norm(ray, axis=1)
    ray /= np.maximum(length, 1e-9)[:, None]
    clear = np.ones(len(points), bool)
    for step in range(steps):
        distance = step * voxel_m
        ask = np.flatnonzero(clear & (distance < length - voxel_m))
        clear[ask] = ~is_occupied(start[ask] + ray[ask] * distance)
    return clear.view(np.uint8)


def by_first_use(
    triangles: NDArray[np.int64], start: NDArray[np.int64], vertices: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Vertices of each tile in the order of their first use, triangles of them, and each tile's start."""
    tile = np.repeat(np.arange(len(start) - 1), np.diff(start))
    in_tile = triangles + tile[:, None] * vertices
    used, first, corner = np.unique(in_tile, return_index=True, return_inverse=True)
    by_use = np.argsort(first)
    number = np.empty(len(used), np.int64)
    number[by_use] = np.arange(len(used))
    return used[by_use] % vertices, number[corner.reshape(-1, 3)], np.searchsorted(first[by_use], 3 * start)


def with_neighbours(points: NDArray[np.float64], radius_m: float, least: int) -> NDArray[np.uint8]:
    """Whether each point has so many others less than a radius away."""
    away2 = ((points[:, None] - points) ** 2).sum(axis=2)
    return ((away2 < radius_m**2).sum(axis=1) > least).astype(np.uint8)
