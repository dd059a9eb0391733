"""Alignment of a scan in motion, in NumPy: what ``native.align_moving`` and ``deskew`` are held against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid

from .registration import DAMPING, NOISE_M, STILL_M, STILL_RAD, Pairs, jacobian_of

PAIRS_PER_OBSERVATION = 20.0
STILL_TWIST = 0.01


def pose_after(twist: NDArray[np.float64], time_s: float) -> NDArray[np.float64]:
    """Pose (4, 4) after a time in the frame at time 0: the exponential of the twist's matrix."""
    (vx, vy, vz), (x, y, z) = twist[:3], twist[3:]
    return expm(time_s * np.array([[0, -z, y, vx], [z, 0, -x, vy], [-y, x, 0, vz], [0, 0, 0, 0]]))


def deskewed(scan: Surface, twist: NDArray[np.float64]) -> Surface:
    """The scan as it would have been seen at time 0."""
    T = np.array([pose_after(twist, float(t)) for t in scan.time_s]).reshape(-1, 4, 4)
    points = np.einsum("nij,nj->ni", T[:, :3, :3], scan.points) + T[:, :3, 3]
    normals = np.einsum("nij,nj->ni", T[:, :3, :3], scan.normals)
    return replace(scan, points=points.astype(np.float32), normals=normals.astype(np.float32))


def align_moving(
    grid: SurfaceGrid,
    scan: Surface,
    T_start: NDArray[np.float64],
    twist_start: NDArray[np.float64],
    scale: NDArray[np.float64],
    iterations: int,
    reach_m: float,
    half_angle: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Aligned pose (4, 4) at time 0, its information (6, 6) and the twist (6,) in the sensor frame.

    Args:
        twist_start: (6,) in the sensor frame.
        scale: (6,) of the twist, linear then angular, along the level axes.
    """
    T, twist, R = T_start.copy(), twist_start, T_start[:3, :3]
    level_twist = np.concatenate([R @ twist[3:], R @ twist[:3]])  # angular then linear
    sigma = np.roll(scale, 3)
    hessian, variance = np.zeros((12, 12)), NOISE_M**2
    for _ in range(iterations):
        seen = deskewed(scan, twist)
        found = Pairs.at(T[None], grid, seen)
        off_m = found.off_m[0]
        weight = np.maximum(1 - (off_m / np.float32(reach_m)) ** 2, 0) ** 2
        weight /= 1 + np.maximum(1 - found.cosine[0] ** 2, 0) / np.float32(half_angle**2)
        off_m[weight == 0] = 0
        by_pose = jacobian_of(found.arms, found.normals)[0]
        jacobian = np.concatenate([by_pose, by_pose * scan.time_s])  # (12, n)
        hessian = ((jacobian * weight) @ jacobian.T).astype(np.float64)
        gradient = ((jacobian * weight) @ off_m).astype(np.float64)
        variance = float((weight * off_m**2).sum() / max(weight.sum(), 1)) + NOISE_M**2
        prior = PAIRS_PER_OBSERVATION * variance / (sigma**2 + level_twist**2)
        gradient[6:] -= prior * level_twist
        hessian[range(6, 12), range(6, 12)] += prior
        damped = hessian.copy()
        damped[range(6), range(6)] += DAMPING * len(scan)
        step = np.linalg.solve(damped, gradient)
        T[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ T[:3, :3]
        T[:3, 3] += step[3:6]
        level_twist += step[6:]
        R = T[:3, :3].T
        twist = np.concatenate([R @ level_twist[3:], R @ level_twist[:3]])
        turned, moved = np.abs(step[:3]).max(), np.abs(step[3:6]).max()
        if turned <= STILL_RAD and moved <= STILL_M and np.abs(step[6:]).max() <= STILL_TWIST:
            break
    cross = hessian[:6, 6:]
    information = hessian[:6, :6] - cross @ np.linalg.solve(hessian[6:, 6:], cross.T)
    return T, information / variance, twist
