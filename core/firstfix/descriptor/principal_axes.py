"""Horizontal principal axes of scans: the frame of PCA-SC (paper III, overview)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .scan_batch import ScanBatch


def principal_axes(scans: ScanBatch, max_range_m: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Angle of the first principal axis in the ground plane, and the eigenvalue ratio, of each scan.

    The paper leaves the axis's sign open. Ours points to the side of the points' mean, so that it turns with
    the scan. A scan without points has angle 0 and ratio 1.

    Returns:
        (n,) angles, radians in (-pi, pi], and (n,) second over first eigenvalue: near 1 the axis means
        nothing.
    """
    moments = np.array([_moments(scans.points[a:b], max_range_m) for a, b in _bounds(scans)])
    mean_x, mean_y, xx, xy, yy = moments.reshape(-1, 5).T
    # eigenvalues and first eigenvector of [[xx, xy], [xy, yy]] in closed form
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    away = np.cos(angle) * mean_x + np.sin(angle) * mean_y < 0
    angle = np.where(away, np.where(angle > 0, angle - np.pi, angle + np.pi), angle)
    middle, half_gap = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    first, second = middle + half_gap, np.maximum(middle - half_gap, 0)
    ratio = np.where(first > 0, second / np.maximum(first, 1e-12), 1.0)
    return angle.astype(np.float32), ratio.astype(np.float32)


def _bounds(scans: ScanBatch) -> zip[tuple[int, int]]:
    return zip(scans.start[:-1].tolist(), scans.start[1:].tolist(), strict=True)


def _moments(points: NDArray[np.float32], max_range_m: float) -> tuple[float, ...]:
    """Means of x and y, and their covariances, over the points in range."""
    x, y = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    inside = x * x + y * y < max_range_m * max_range_m
    if not inside.all():
        x, y = x[inside], y[inside]
    n = max(len(x), 1)
    mean_x, mean_y = float(x.sum()) / n, float(y.sum()) / n
    x -= mean_x
    y -= mean_y
    return mean_x, mean_y, float(x @ x) / n, float(x @ y) / n, float(y @ y) / n
