"""Levelling: the up direction of a scan, and the height of the sensor above the floor.

Handheld and legged robots tilt by 20 degrees, and a descriptor in a tilted frame finds nothing. Man-made
places are full of level surfaces (floors, ceilings) and upright ones (walls). Up is the direction to which
most surface normals are parallel or at right angles (docs/method.md section 2). No floor needs to be seen.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from .reduction import at_most

_Float = TypeVar("_Float", bound=np.floating)

MAX_TILT_DEG = 35.0
LEVEL_WEIGHT = 0.1  # of a level surface against an upright one: walls are upright, floors and roads may slope
_COARSE_STEP_DEG = 4.0
_VOTE_WIDTH = np.radians(5.0)
_VOTERS = 2000  # normals that vote: all 10,000 of a scan give the same up within 0.1 degrees
_FLOOR_RADIUS_M = 12.0
_FLOOR_BIN_M = 0.1
_LEVEL_COSINE = 0.9659258262890683  # of 15 degrees
_UPRIGHT_COSINE = 0.25881904510252074  # of 75 degrees
_FOOT_M = 0.15  # walls that reach further below a level surface stand on another one
_MIN_BELOW, _MIN_BELOW_SHARE = 20, 0.01  # of the points on upright surfaces
_UPSIDE_DOWN = -1 + 1e-12


def estimate_up(normals: NDArray[np.floating]) -> NDArray[np.float64]:
    """Unit up vector, within MAX_TILT_DEG of sensor z, from (n, 3) unit surface normals of any sign.

    A vote over a grid of directions, then three rounds of reweighted least squares: the smallest eigenvector
    of (upright - level) scatter is at right angles to the walls' normals and parallel to the floor's.
    """
    candidates = directions_about_z(MAX_TILT_DEG)
    normals = at_most(normals, _VOTERS)
    voted = candidates[int(np.argmax(votes(normals, candidates) * _tilt_prior(MAX_TILT_DEG)))]
    return refined_up(normals, voted)


def estimate_up_near(normals: NDArray[np.floating], expected: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit up vector as ``estimate_up`` finds it, within MAX_TILT_DEG of an expected one, (3,)."""
    R_expected_sensor = levelling_rotation(expected)
    return R_expected_sensor.T @ estimate_up(np.ascontiguousarray(turned(normals, R_expected_sensor)))


@accelerated
def refined_up(normals: NDArray[np.floating], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit up vector, refined from a direction that (n, 3) normals voted for (docs/method.md 2.2)."""
    for width_deg in (5.0, 2.5, 1.5):
        width = np.radians(width_deg)
        along = normals @ up
        level = np.exp(-(1 - along**2) / (2 * width**2))
        upright = np.exp(-(along**2) / (2 * width**2))
        scatter = (normals * (upright - LEVEL_WEIGHT * level)[:, None]).T @ normals
        refined = np.linalg.eigh(scatter)[1][:, 0]
        refined = refined if refined @ up > 0 else -refined
        if refined @ up < np.cos(np.radians(6.0)):  # one direction is not constrained: keep the vote
            break
        up = refined
    return up


@accelerated
def votes(normals: NDArray[np.floating], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Votes of (n, 3) normals for each of (d, 3) directions as up (docs/method.md 2.1)."""
    along2 = (normals.astype(np.float32) @ directions.T.astype(np.float32)) ** 2  # (n, directions)
    scale = np.float32(-1 / (2 * _VOTE_WIDTH**2))
    found: NDArray[np.float64] = (np.exp(along2 * scale) + np.exp((1 - along2) * scale)).sum(
        axis=0, dtype=np.float64
    )
    return found


def levelling_rotation(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """R_level_sensor (3, 3), the smallest rotation that brings up to z, computed in a fixed order of steps.

    Args:
        up: (3,) of any length but zero.
    """
    x, y, z = (float(v) for v in up)
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    if z < _UPSIDE_DOWN:  # any axis at right angles will do
        return np.diag([-1.0, 1.0, -1.0])
    k = 1 + z
    return np.array([[1 - x * x / k, -(x * y) / k, -x], [-(x * y) / k, 1 - y * y / k, -y], [x, y, z]])


@accelerated
def turned(points: NDArray[_Float], R: NDArray[np.float64]) -> NDArray[_Float]:
    """Rotate (n, 3) points by R, in their own precision.

    The order of steps is fixed, which a matrix product does not guarantee.
    """
    x, y, z = np.ascontiguousarray(points.T)
    out = np.empty((3, len(points)), points.dtype)
    for row, (a, b, c) in zip(out, R.astype(points.dtype), strict=True):
        np.multiply(x, a, out=row)
        row += y * b
        row += z * c
    return out.T


@accelerated
def floor_height(
    points: NDArray[np.floating], normals: NDArray[np.floating], max_height_m: float = 4.0
) -> float | None:
    """Height of the sensor above the floor around it, or None if no floor is seen.

    The floor is the lowest height with many points on level surfaces below the sensor. A table is not: walls
    reach further down. A sensor that looks down a few degrees often sees tables and no floor.

    Args:
        points, normals: (n, 3) in the levelled sensor frame.
    """
    x, y, z = points.T
    near = x * x + y * y < _FLOOR_RADIUS_M * _FLOOR_RADIUS_M
    upright_z = z[near & (np.abs(normals[:, 2]) < _UPRIGHT_COSINE)]
    z = z[near & (np.abs(normals[:, 2]) > _LEVEL_COSINE)]
    z = z[(z < -0.05) & (z > -max_height_m)]
    if len(z) < 20:
        return None
    bins = np.floor(-z / _FLOOR_BIN_M).astype(int)
    counts = np.bincount(bins)
    smooth = counts.copy()  # each bin with those above and below
    smooth[1:] += counts[:-1]
    smooth[:-1] += counts[1:]
    strong = np.flatnonzero(smooth >= 0.35 * smooth.max())
    deepest = strong[-1]
    while deepest > 0 and smooth[deepest - 1] > smooth[deepest]:  # climb to the top of that hump
        deepest -= 1
    members = z[np.abs(bins - deepest) <= 1]
    if not len(members):
        return None
    height_m = float(-np.median(members))
    below = np.count_nonzero(upright_z < -(height_m + _FOOT_M))
    return None if below >= max(_MIN_BELOW, _MIN_BELOW_SHARE * len(upright_z)) else height_m


@cache
def directions_about_z(within_deg: float) -> NDArray[np.float64]:
    """Unit vectors (d, 3) within an angle of z, about _COARSE_STEP_DEG apart."""
    directions = [(0.0, 0.0, 1.0)]
    for tilt_deg in np.arange(_COARSE_STEP_DEG, within_deg + 1e-9, _COARSE_STEP_DEG):
        tilt = np.radians(tilt_deg)
        around = max(6, round(2 * np.pi * np.sin(tilt) / np.radians(_COARSE_STEP_DEG)))
        for azimuth in np.linspace(0, 2 * np.pi, around, endpoint=False):
            directions.append((np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)))
    return np.array(directions)


@cache
def _tilt_prior(within_deg: float) -> NDArray[np.float64]:
    """Weak preference for an upright sensor, which decides if the surfaces do not.

    (d,) of the ``directions_about_z``.
    """
    tilt_deg = np.degrees(np.arccos(np.clip(directions_about_z(within_deg)[:, 2], -1, 1)))
    prior: NDArray[np.float64] = 1 - 0.15 * tilt_deg / MAX_TILT_DEG
    return prior
