"""Alignment with a surface grid in NumPy: the kernels of ``firstfix.native`` are held against it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from firstfix.bit_exact.atan2 import atan2_turns
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.engine.registration.surface_grid_build import BLOCK_BITS, CellsOf
from firstfix.transform import pose_error

OTHER_FACE = -0.2  # cosine: normals further apart face opposite ways, even with noise
STILL_M, STILL_RAD = 5e-4, 1e-4
DAMPING = 1e-4  # of a pair's weight: keeps the pose along directions that the scan does not constrain
UPRIGHT = 0.5  # |z| of a normal that is less: no floor, no ceiling
SECTORS, PLANE_M = 16, 0.5  # of the normals of planes, and between planes
NOISE_M = 0.01  # standard deviation of a scan point's distance from the map, at least


def nearest(grid: SurfaceGrid, points: NDArray[np.float32]) -> NDArray[np.int32]:
    """Rows (n,) of the surface near (n, 3) positions relative to the corner; -1: none."""
    block_bits = grid.point.shape[1].bit_length() - 1
    group_bits = block_bits + grid.block.shape[1].bit_length() - 1
    last = np.array(grid.group.shape, np.float32) * (1 << group_bits) - 1
    cell = (points * (1 / grid.cell)).clip(0, last).astype(np.int32)
    return grid.point.ravel()[slot_of(cell, grid.group, grid.block, block_bits)]


def slot_of(
    cell: NDArray[np.int32], group: NDArray[np.int32], block: NDArray[np.int32], block_bits: int
) -> NDArray[np.int64]:
    """Positions (n,) of (n, 3) cells among the cells of the kept blocks."""
    side_bits = block.shape[1].bit_length() - 1
    _, columns, layers = group.shape
    outer = cell >> block_bits
    x, y, z = (outer >> side_bits).T
    number = group.ravel()[(x * columns + y) * layers + z]
    number = block.ravel()[(number.astype(np.int64) << 3 * side_bits) + _within(outer, side_bits)]
    return (number.astype(np.int64) << 3 * block_bits) + _within(cell, block_bits)


def _within(cell: NDArray[np.int32], bits: int) -> NDArray[np.int32]:
    """Numbers of (n, 3) cells in a cube of 2**bits a side."""
    inner = cell & ((1 << bits) - 1)
    number: NDArray[np.int32] = ((inner[:, 0] << bits) + inner[:, 1] << bits) + inner[:, 2]
    return number


def nearest_points(
    cells: CellsOf, group: NDArray[np.int32], block: NDArray[np.int32], first: int, end: int
) -> NDArray[np.int32]:
    """Points (end - first, s, s, s) nearest to the centres of the cells of some blocks; -1: none."""
    side = 1 << BLOCK_BITS
    nothing = np.iinfo(np.int64).max
    best = np.full((end - first) * side**3, nothing)
    cell, offset = cells.of(slice(None))
    for step in product((-1, 0, 1), repeat=3):
        away = offset - np.asarray(step, np.float32) - np.float32(0.5)
        distance2 = np.square(away).sum(axis=1)
        slot = slot_of(cell + np.array(step, np.int32), group, block, BLOCK_BITS) - first * side**3
        entry = (distance2 * 2**20).astype(np.int64) << 32 | np.arange(len(cell))
        inside = (slot >= 0) & (slot < len(best))
        np.minimum.at(best, slot[inside], entry[inside])
    return np.where(best == nothing, -1, best & 0xFFFFFFFF).astype(np.int32).reshape(-1, side, side, side)


@dataclass(frozen=True)
class Pairs:
    """Surface points nearest to the points of a scan at k poses, (k, n, ...).

    Attributes:
        arms: points relative to the sensor, along the level axes.
        off_m: distance to the surface along its normal; infinite if no surface is near, or only one that
            faces the other way.
        normals: of the surface.
        cosine: of the angle between the two normals.
        on_surface: whether any surface is near.
    """

    arms: NDArray[np.float32]
    off_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    cosine: NDArray[np.float32]
    on_surface: NDArray[np.bool_]

    @classmethod
    def at(cls, T_level_sensor: NDArray[np.float64], grid: SurfaceGrid, scan: Surface) -> Pairs:
        turn = T_level_sensor[:, None, :3, :3].astype(np.float32)
        arms = np.stack([_dot(turn[..., axis, :], scan.points) for axis in range(3)], axis=-1)
        points = arms + (T_level_sensor[:, None, :3, 3] - grid.corner).astype(np.float32)
        row = nearest(grid, points.reshape(-1, 3)).reshape(points.shape[:2])
        turned = np.stack([_dot(turn[..., axis, :], scan.normals) for axis in range(3)], axis=-1)

        def on_other_face() -> NDArray[np.bool_]:
            faces_away = _dot(turned, grid.planes[row][..., :3]) < OTHER_FACE
            return (row >= 0) & faces_away & grid.oriented[row] & scan.oriented

        behind = grid.other_face[row]
        row = np.where(on_other_face() & (behind >= 0), behind, row)
        planes = grid.planes[row]
        normals = planes[..., :3]
        off_m = planes[..., 3] - _dot(points, normals)
        off_m[(row < 0) | on_other_face()] = np.inf
        return cls(arms, off_m, normals, _dot(turned, normals), row >= 0)


def _dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    """Scalar products along the last axis, added in order: no library's sum, whose order is its own."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def align(
    grid: SurfaceGrid,
    scan: Surface,
    T_start: NDArray[np.float64],
    iterations: int,
    reach_m: float,
    half_angle: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Aligned poses (k, 4, 4) and their information (k, 6, 6).

    Gauss-Newton over left perturbations: rotation about the sensor, translation along the level axes.
    """
    T = T_start.copy()
    moving = np.arange(len(T))  # those that have not converged
    hessian = np.zeros((len(T), 6, 6))
    squares, pairs = np.zeros(len(T)), np.ones(len(T))
    for _ in range(iterations):
        found = Pairs.at(T[moving], grid, scan)
        off_m = found.off_m
        weight = np.maximum(1 - (off_m / np.float32(reach_m)) ** 2, 0) ** 2  # Tukey's; 0 without a surface
        weight /= 1 + np.maximum(1 - found.cosine**2, 0) / np.float32(half_angle**2)
        jacobian = jacobian_of(found.arms, found.normals)  # (k, 6, n)
        weighted = jacobian * weight[:, None]
        off_m[weight == 0] = 0  # infinite ones
        pairs[moving] = weight.sum(axis=1)
        squares[moving] = (weight * off_m**2).sum(axis=1)
        hessian[moving] = weighted @ jacobian.transpose(0, 2, 1)
        gradient = (weighted @ off_m[..., None]).astype(np.float64)
        damped = hessian[moving] + DAMPING * len(scan) * np.eye(6)
        step = np.linalg.solve(damped, gradient)[..., 0]
        T[moving, :3, :3] = Rotation.from_rotvec(step[:, :3]).as_matrix() @ T[moving, :3, :3]
        T[moving, :3, 3] += step[:, 3:]
        turned, moved = np.abs(step[:, :3]).max(axis=1), np.abs(step[:, 3:]).max(axis=1)
        moving = moving[(turned > STILL_RAD) | (moved > STILL_M)]
        if not len(moving):
            break
    variance = squares / np.maximum(pairs, 1) + NOISE_M**2
    return T, hessian / variance[:, None, None]


def quality(
    grid: SurfaceGrid, scan: Surface, T: NDArray[np.float64], inlier_distance_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Inlier ratio (k,) and alignment score (k,) at (k, 4, 4) poses."""
    share = np.abs(Pairs.at(T, grid, scan).off_m).astype(np.float64) / inlier_distance_m
    return (share <= 1).mean(axis=1), np.maximum(1 - share**2, 0).mean(axis=1)


def agreement(
    grid: SurfaceGrid, coarse: SurfaceGrid, scan: Surface, T: NDArray[np.float64], inlier_distance_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shares beside a surface (k,) and chances of one plane (k,) at (k, 4, 4) poses."""
    found = [_agreement_at(grid, coarse, scan, pose, inlier_distance_m) for pose in T]
    beside, same = np.array(found).reshape(-1, 2).T
    return beside, same


def _agreement_at(
    grid: SurfaceGrid, coarse: SurfaceGrid, scan: Surface, T: NDArray[np.float64], inlier_distance_m: float
) -> tuple[float, float]:
    pairs = Pairs.at(T[None], grid, scan)
    off_surface = ~pairs.on_surface[0]
    from_corner = pairs.arms[0][off_surface] + (T[:3, 3] - coarse.corner).astype(np.float32)
    cells = np.array(coarse.group.shape) * coarse.block.shape[1] * coarse.point.shape[1]
    scaled = from_corner / coarse.cell
    inside = ((scaled >= 0) & (scaled < cells)).all(axis=1)
    beside = int((nearest(coarse, from_corner[inside]) >= 0).sum()) / max(len(scan), 1)
    level = np.stack([_dot(T[axis, :3].astype(np.float32), scan.normals) for axis in range(3)], axis=-1)
    agree = (np.abs(pairs.off_m[0]) <= inlier_distance_m) & (np.abs(level[:, 2]) < UPRIGHT)
    turns = atan2_turns(level[:, 1], level[:, 0])
    sector = (turns * np.float32(SECTORS) + np.float32(SECTORS / 2 + 0.5)).astype(int)
    away = (np.abs(_dot(scan.points, scan.normals)) / np.float32(PLANE_M) + np.float32(0.5)).astype(int)
    _, count = np.unique(np.stack([sector % SECTORS, away])[:, agree], axis=1, return_counts=True)
    both = int(count.sum())
    return beside, 1.0 if both < 2 else float((count * (count - 1)).sum() / (both * (both - 1)))


def distinct_poses(T: NDArray[np.float64], within_m: float, within_deg: float, most: int) -> list[int]:
    """Rows of the poses, (k, 4, 4), that are not nearly the same as a kept one before them."""
    kept: list[int] = []
    for row, pose in enumerate(T):
        errors = [pose_error(T[other], pose) for other in kept]
        if len(kept) < most and not any(m < within_m and deg < within_deg for m, deg in errors):
            kept.append(row)
    return kept


def jacobian_of(arms: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Jacobian (k, 6, n) of each pair's distance.

    By the rotation about the sensor it is the cross product of arm and normal, by the translation the normal.
    """
    jacobian = np.empty((len(arms), 6, arms.shape[1]), np.float32)
    a, n = arms.transpose(2, 0, 1), normals.transpose(2, 0, 1)
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        jacobian[:, axis] = a[after] * n[last] - a[last] * n[after]
        jacobian[:, 3 + axis] = n[axis]
    return jacobian
