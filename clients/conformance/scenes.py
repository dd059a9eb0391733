"""Scans of the vectors: small, seeded, and the same on every machine.

Coordinates are rounded to 1/1024 m, so that the files do not depend on the last digits of a library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.levelling import levelling_rotation

Points = NDArray[np.float32]  # (n, 3) metres, sensor frame


def room() -> Points:
    """A room of 12 x 8 x 3 m with a pillar, points in random order, sensor tilted by seven degrees."""
    rng = np.random.default_rng(6)
    rays = rng.random((4000, 3)) * 2 - 1
    low, high = np.array([-7.0, -3.0, -1.2]), np.array([5.0, 5.0, 1.8])
    ranges = np.where(rays > 0, high / rays, low / rays).min(axis=1)
    pillar = (np.abs(rays[:, 1]) < 0.15 * rays[:, 0]) & (np.abs(rays[:, 2]) < 0.9 * rays[:, 0])
    ranges[pillar] = 2.0 / rays[pillar, 0]
    return _rounded((rays * ranges[:, None] + rng.random((4000, 3)) * 0.02 - 0.01) @ _lean(0.1, -0.06))


def street() -> Points:
    """A spinning sensor with sixteen beams between two rows of houses, in the sensor's order."""
    rng = np.random.default_rng(7)
    azimuth = np.repeat(np.arange(300) * (2 * np.pi / 300), 16)
    elevation = np.radians(np.tile(np.linspace(-15, 15, 16), 300))
    x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    z = np.sin(elevation)
    ground = np.where(z < 0, -1.8 / np.minimum(z, -1e-9), np.inf)
    setbacks_m = np.floor(np.arange(4800) / 160) % 3  # of the houses on the right
    houses = np.where(y >= 0, 9.0, -7.0 - 2.0 * setbacks_m) / np.where(y == 0, 1e-9, y)
    ranges = np.minimum(ground, houses)
    ranges = np.where(ranges * z > 6.5, np.inf, ranges)  # above the roofs
    ranges = ranges + rng.random(4800) * 0.04 - 0.02
    seen = ranges < 120
    return _rounded(np.stack([x, y, z], axis=1)[seen] * ranges[seen, None])


def edges() -> Points:
    """Edge cases: borders of cells, the axes, half steps, the limits of the range."""
    axes = [[s * v for v in axis] for axis in np.eye(3).tolist() for s in (1.0, -1.0)]
    diagonals = [[x, y, z] for x in (-3, 3) for y in (-3, 3) for z in (-3, 0, 3)]
    halves = [[k * 0.005, -k * 0.005, 0.5 + k * 0.01] for k in (1, 3, 5, 101)]
    cubes = [[0.3 * k, 0.6, -0.9] for k in (-3, -1, 1, 2, 7)]
    limits = [[0.5, 0, 0], [0, 0.5000001, 0], [59.99999, 0, 0], [60, 0, 0], [0, -0.29999998, 0], [0, 0, 0.3]]
    zeros = [[0, 0, 0], [-0.0, -0.0, -0.0], [1, -0.0, 0], [-1, -0.0, 0], [-2, 1e-30, 0], [0, 0, -4]]
    ends = [[327.67, -327.67, 5], [327.66, 0, -327.67]]
    return np.array(axes + diagonals + halves + cubes + limits + zeros + ends, np.float32)


def near_edges() -> Points:
    """Points of ``edges`` within the range of a compact query."""
    points = edges()
    return points[np.abs(points).max(axis=1) <= 60]


def far() -> Points:
    """Beyond the reach of two bytes at 1 cm, unless the origin moves."""
    return _rounded(np.random.default_rng(8).random((40, 3)) * [300, 200, 20] + [500, -900, 3])


def across() -> Points:
    """Too wide for two bytes with any origin."""
    return np.array([[-999.5, 3, 1], [1000, -1000, 0.125], [0, 2, 700.25]], np.float32)


def all_directions() -> Points:
    """Two points in each direction, one behind the other: along every axis, and random directions."""
    rng = np.random.default_rng(10)
    spread = rng.random((400, 3)) * 2 - 1
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    near = np.concatenate([axes, spread]) * (rng.random((406, 1)) * 40 + 0.5)
    return np.concatenate([_rounded(near), _rounded(near) * np.float32(1.5)])


def _lean(x: float, y: float) -> NDArray[np.float64]:
    """(3, 3) rotation of a sensor whose up is (x, y, 1), to multiply rows with."""
    return levelling_rotation(np.array([x, y, 1.0]))


def _rounded(points: NDArray[np.float64]) -> Points:
    return (np.rint(points * 1024) / 1024).astype(np.float32)
