"""The paper's descriptor: Scan Context in the frame of the scan's principal axes (PCA-SC), and CNZ.

Paper III.A and III.C. Everything works on a batch: the points of n scans one after another, with the
number of the scan that each point belongs to. One scan is a batch of one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .polar import PolarGrid


@dataclass(frozen=True)
class Descriptors:
    """PCA-SC of n scans.

    Attributes:
        angle_rad: (n,) float32, of the first principal axis in the levelled sensor frame.
        ratio: (n,) float32 in 0..1, second eigenvalue over first: near 1 the axis means nothing.
        context: (n, rings, sectors) float32, maximum height above the floor, 0 where empty.
    """

    angle_rad: NDArray[np.float32]
    ratio: NDArray[np.float32]
    context: NDArray[np.float32]


def describe(
    points: NDArray[np.float32],
    scan_of_point: NDArray[np.intp],
    scans: int,
    height_m: NDArray[np.float32],
    grid: PolarGrid,
) -> Descriptors:
    """PCA-SC of a batch of levelled scans.

    Args:
        points: (p, 3) metres, levelled sensor frame, all scans one after another.
        scan_of_point: (p,) the scan each point belongs to, in 0..scans-1.
        height_m: (scans,) of each sensor above its floor: the height origin is the floor, so that
            the descriptor does not change with the mount.
    """
    angle, ratio = principal_axes(points, scan_of_point, scans, grid.max_range_m)
    c, s = np.cos(angle)[scan_of_point], np.sin(angle)[scan_of_point]
    x, y = points[:, 0], points[:, 1]
    rows, cell = grid.cells(c * x + s * y, c * y - s * x)
    scan = scan_of_point[rows]
    context = np.zeros(scans * grid.rings * grid.sectors, np.float32)
    np.maximum.at(context, scan * (grid.rings * grid.sectors) + cell, points[rows, 2] + height_m[scan])
    return Descriptors(angle, ratio, context.reshape(scans, grid.rings, grid.sectors))


def principal_axes(
    points: NDArray[np.float32], scan_of_point: NDArray[np.intp], scans: int, max_range_m: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Angle of the first principal axis in the ground plane, and the eigenvalue ratio, of each scan.

    The paper leaves the axis's sign open: ours points to the side where the points' mean lies, so
    that turning the scan turns the axis with it. A scan without points has angle 0 and ratio 1.

    Returns:
        (scans,) radians in (-pi, pi], (scans,) second over first eigenvalue.
    """
    x, y = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    weight = (x * x + y * y < max_range_m * max_range_m).astype(np.float64)

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(scan_of_point, weights=values, minlength=scans).astype(np.float64)

    x *= weight
    y *= weight
    n = np.maximum(total(weight), 1)
    mean_x, mean_y = total(x) / n, total(y) / n
    xx = total(x * x) / n - mean_x**2
    xy = total(x * y) / n - mean_x * mean_y
    yy = total(y * y) / n - mean_y**2
    # eigenvalues and first eigenvector of [[xx, xy], [xy, yy]] in closed form
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    away = np.cos(angle) * mean_x + np.sin(angle) * mean_y < 0
    angle = np.where(away, np.where(angle > 0, angle - np.pi, angle + np.pi), angle)
    middle, half_gap = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    first, second = middle + half_gap, np.maximum(middle - half_gap, 0)
    ratio = np.where(first > 0, second / np.maximum(first, 1e-12), 1.0)
    return angle.astype(np.float32), ratio.astype(np.float32)


def cnz(context: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n, rings, sectors) to the paper's search key (n, rings): share of non-empty sectors per ring."""
    return (context > 0).mean(axis=-1, dtype=np.float32)
