"""Rigid transforms: (4, 4) float64 matrices, named by both frames.

``T_map_sensor`` brings a point from the sensor frame to the map frame. Quaternions are (x, y, z, w), as in
ROS and OGC GeoPose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Matrix = NDArray[np.float64]


def make_transform(rotation: ArrayLike, translation: ArrayLike) -> Matrix:
    """Transform (4, 4) from a (3, 3) rotation and a (3,) translation."""
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = translation
    return T


def from_quaternion(translation: ArrayLike, quaternion_xyzw: ArrayLike) -> Matrix:
    """Transform from a (3,) translation in metres and an (x, y, z, w) quaternion of any length but zero.

    Raises:
        ValueError: the length of the quaternion is zero or not finite.
    """
    x, y, z, w = np.asarray(quaternion_xyzw, np.float64).tolist()
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not math.isfinite(length) or length < 1e-9:
        raise ValueError("the quaternion has no direction")
    x, y, z, w = x / length, y / length, z / length, w / length
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return make_transform(rotation, translation)


def quaternion_of(T: Matrix) -> NDArray[np.float64]:
    """Quaternion (x, y, z, w) with w >= 0, by Shepperd's method, which is stable at every angle."""
    return np.array(quaternion_of_rows(T.tolist()))


def quaternion_of_rows(rows: list[list[float]]) -> list[float]:
    """``quaternion_of`` a transform as lists of numbers, without an array: for many small transforms."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row[:3] for row in rows[:3])
    t = xx + yy + zz
    if t > max(xx, yy, zz):
        q = [zy - yz, xz - zx, yx - xy, 1 + t]
    elif xx >= max(yy, zz):
        q = [1 + 2 * xx - t, yx + xy, zx + xz, zy - yz]
    elif yy >= zz:
        q = [yx + xy, 1 + 2 * yy - t, zy + yz, xz - zx]
    else:
        q = [zx + xz, zy + yz, 1 + 2 * zz - t, yx - xy]
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    length = -length if q[3] < 0 else length
    return [v / length for v in q]


def inverse(T: Matrix) -> Matrix:
    """Inverse of a transform: from ``T_map_sensor`` to ``T_sensor_map``, the same bits on every processor."""
    R, t = T[:3, :3], T[:3, 3]
    return make_transform(R.T, -(R[0] * t[0] + R[1] * t[1] + R[2] * t[2]))


def product(T_a_b: Matrix, T_b_c: Matrix) -> Matrix:
    """Product of two transforms, whose sums have one order: the same bits on every processor."""
    made: Matrix = T_a_b[:, :1] * T_b_c[0]
    for k in (1, 2, 3):
        made += T_a_b[:, k : k + 1] * T_b_c[k]
    return made


def transform_points(T: Matrix, points: ArrayLike) -> NDArray[np.float64]:
    """Bring (n, 3) points from the right frame of T to its left frame."""
    return np.asarray(points, np.float64) @ T[:3, :3].T + T[:3, 3]


def rotation_z(yaw_rad: float) -> NDArray[np.float64]:
    """Rotation (3, 3) about z."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def yaw_of(T: Matrix) -> float:
    """Heading of the x axis about z of the left frame, in radians."""
    return float(np.arctan2(T[1, 0], T[0, 0]))


def rotation_between(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Smallest rotation (3, 3) that turns direction a into direction b (Rodrigues)."""
    u = np.asarray(a, np.float64) / np.linalg.norm(a)
    v = np.asarray(b, np.float64) / np.linalg.norm(b)
    axis, cosine = np.cross(u, v), float(u @ v)
    if cosine < -1 + 1e-12:  # opposite: any axis at right angles will do
        helper = np.eye(3)[int(np.argmin(np.abs(u)))]
        axis = np.cross(u, helper)
        axis /= np.linalg.norm(axis)
        half_turn: Matrix = 2 * np.outer(axis, axis) - np.eye(3)
        return half_turn
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation: Matrix = np.eye(3) + K + K @ K / (1 + cosine)
    return rotation


def rotation_angle_deg(R: Matrix) -> float:
    """Angle in degrees of a (3, 3) rotation, or of the rotation in a (4, 4) transform."""
    # atan2 of sine and cosine: accurate near 0, where arccos of the trace is not
    sine = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    cosine = (R[0, 0] + R[1, 1] + R[2, 2] - 1) / 2
    return float(np.degrees(np.arctan2(sine, cosine)))


def pose_error(T_map_true: Matrix, T_map_estimate: Matrix) -> tuple[float, float]:
    """Distance in metres and angle in degrees between two poses."""
    E = inverse(T_map_true) @ T_map_estimate
    return float(np.linalg.norm(E[:3, 3])), rotation_angle_deg(E)


def pose_to_mapping(T: Matrix) -> dict[str, list[float]]:
    """A pose as JSON has it: a position in metres and a quaternion x, y, z, w."""
    rows = T.tolist()
    return {
        "position": [row[3] for row in rows[:3]],
        "quaternion": quaternion_of_rows(rows),
    }


def pose_from_mapping(data: Mapping[str, Any]) -> Matrix:
    """Read what ``pose_to_mapping`` returned."""
    return from_quaternion(data["position"], data["quaternion"])
