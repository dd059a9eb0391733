"""Converts rows of numbers to rigid transforms, and refuses rows that are none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.transform import from_quaternion

MAX_ABS = 1e9  # metres
_TOLERANCE = 0.02  # files round to as little as 4 digits


def are_unit(quaternions: NDArray[np.float64]) -> bool:
    """Whether all rows of (m, 4) have length 1."""
    return bool((np.abs(np.linalg.norm(quaternions, axis=1) - 1) < _TOLERANCE).all())


def rigid_from_quaternions(
    translations: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(m, 3) and (m, 4) to (m, 4, 4). Raises MalformedData on a row that is no pose."""
    _require_finite(np.hstack([translations, quaternions_xyzw]))
    if not are_unit(quaternions_xyzw):
        raise MalformedData("poses: a quaternion is not of length 1")
    return np.stack([from_quaternion(t, q) for t, q in zip(translations, quaternions_xyzw, strict=True)])


def rigid_from_angles(
    translations: NDArray[np.float64], roll_pitch_yaw_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(m, 3) and (m, 3) to (m, 4, 4): R = Rz(yaw) Ry(pitch) Rx(roll), as PCL's getTransformation."""
    _require_finite(np.hstack([translations, roll_pitch_yaw_rad]))
    (cr, cp, cy), (sr, sp, sy) = np.cos(roll_pitch_yaw_rad).T, np.sin(roll_pitch_yaw_rad).T
    T = np.tile(np.eye(4), (len(translations), 1, 1))
    T[:, 0, :3] = np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], axis=1)
    T[:, 1, :3] = np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], axis=1)
    T[:, 2, :3] = np.stack([-sp, cp * sr, cp * cr], axis=1)
    T[:, :3, 3] = translations
    return T


def rigid_matrices(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, 3, 4) or (m, 4, 4) to (m, 4, 4), rounding in the rotations taken out.

    Raises:
        MalformedData: a rotation that is none, or a last row that is not 0 0 0 1.
    """
    _require_finite(matrices.reshape(len(matrices), -1))
    rotations = matrices[:, :3, :3]
    product = rotations @ rotations.transpose(0, 2, 1)
    last_row_is_bad = matrices.shape[1] == 4 and np.abs(matrices[:, 3] - [0, 0, 0, 1]).max() > _TOLERANCE
    if (
        np.abs(product - np.eye(3)).max() > _TOLERANCE
        or np.linalg.det(rotations).min() < 0
        or last_row_is_bad
    ):
        raise MalformedData("poses: a matrix is not a rigid transform")
    u, _, vt = np.linalg.svd(rotations)
    T = np.tile(np.eye(4), (len(matrices), 1, 1))
    T[:, :3, :3] = u @ vt
    T[:, :3, 3] = matrices[:, :3, 3]
    return T


def _require_finite(rows: NDArray[np.float64]) -> None:
    """Check (m, k) numbers: finite, and none as large as a time since the epoch in a column of lengths."""
    bad = ~(np.abs(np.nan_to_num(rows, nan=np.inf)) < MAX_ABS).all(axis=1)
    if not bad.any():
        return
    number = int(np.argmax(bad))
    if not np.isfinite(rows[number]).all():
        raise MalformedData(f"poses: pose {number + 1} has a number that is not finite")
    largest = np.abs(rows[number]).max()
    raise MalformedData(
        f"poses: pose {number + 1} has the number {largest:.6g}, which is no length in metres: is it a time? "
        "Write rows of t x y z qx qy qz qw, or a first line that names tx, ty, tz, qx, qy, qz, qw"
    )
