"""A hall as even points, and a way through it: small, and right in all that the check of maps looks at."""

from __future__ import annotations

import numpy as np

from firstfix.transform import rotation_z

SIZE = np.array([40.0, 16.0, 4.0])
SENSOR_M, SPACING_M, NOISE_M = 1.0, 0.14, 0.01


def sheet(
    low: tuple[float, float, float], high: tuple[float, float, float], spacing_m: float = SPACING_M
) -> np.ndarray:
    """Even points, a little noisy, on a rectangle that is flat along one axis."""
    low_m, high_m = np.array(low), np.array(high)
    counts = [max(1, round(one / spacing_m)) for one in high_m - low_m]
    axes = [low_m[k] + (np.arange(counts[k]) + 0.5) / counts[k] * (high_m - low_m)[k] for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points + np.random.default_rng(len(points)).normal(0, NOISE_M, points.shape)


def hall(spacing_m: float = SPACING_M) -> np.ndarray:
    """A hall with two rooms, a shelf with three boards, a table, and a step of 0.3 m over a quarter of it."""
    x, y, z = SIZE
    walls = [((0, 0, 0), (x, 0, z)), ((0, y, 0), (x, y, z)), ((0, 0, 0), (0, y, z)), ((x, 0, 0), (x, y, z))]
    inner = [((20, 0, 0), (20, 6, z)), ((20, 10, 0), (20, y, z)), ((30, 0, 0), (30, 0.1, 0.3))]
    boards = [((5, 14, h), (12, 15.5, h)) for h in (0.3, 0.8, 1.3)]
    things = [
        *boards,
        ((8, 2, 0.74), (12, 4, 0.74)),
        ((30, 0.1, 0.3), (x, y, 0.3)),
        ((30, 0, 0), (30, y, 0.3)),
    ]
    floors = [((0, 0, 0), (30, y, 0)), ((0, 0, z), (x, y, z))]
    return np.concatenate([sheet(*one, spacing_m) for one in (*walls, *inner, *things, *floors)])


def posed(positions: np.ndarray) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    # turned by a little each, as no points of a cloud are
    poses[:, :3, :3] = np.stack([rotation_z(0.01 * k) for k in range(len(positions))])
    return poses


def way(height_m: float = SENSOR_M) -> np.ndarray:
    """There in one aisle of the hall, and back in the other."""
    x = np.linspace(2, 28, 60)
    there, back = np.column_stack([x, np.full(60, 7.0)]), np.column_stack([x[::-1], np.full(60, 9.0)])
    xy = np.concatenate([there, back])
    return np.column_stack([xy, np.full(len(xy), height_m)])
