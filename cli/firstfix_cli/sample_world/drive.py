"""A robot's drive along a path: rounded corners, constant speed, sensor upright on the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from .place import Place, ground_normals

FINE_STEP_M = 0.05


def drive(place: Place) -> NDArray[np.float64]:
    """Poses T_world_sensor (m, 4, 4), one every stride, along the place's path."""
    floor = smoothed(place)
    forward = np.gradient(floor, axis=0)
    up = None if place.ground is None else ground_normals(place.ground, floor[:, :2])
    distance = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(floor, axis=0), axis=1))])
    stops = np.searchsorted(distance, np.arange(0, distance[-1], place.stride_m))
    return poses_on(
        floor[stops], forward[stops], None if up is None else up[stops], place.sensor.mount_height_m
    )


def smoothed(place: Place) -> NDArray[np.float64]:
    """The path as a smooth line (n, 3) over the floor, points FINE_STEP_M apart or less."""
    corners = place.path
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    steps = np.linspace(0, at[-1], int(np.ceil(at[-1] / FINE_STEP_M)) + 1)
    line: NDArray[np.float64] = np.column_stack([np.interp(steps, at, corners[:, axis]) for axis in range(3)])
    line = np.asarray(
        gaussian_filter1d(line, place.corner_m / FINE_STEP_M, axis=0, mode="nearest"), np.float64
    )
    if place.ground is not None:
        line[:, 2] = place.ground(line[:, 0], line[:, 1])
    return line


def poses_on(
    floor: NDArray[np.float64],
    forward: NDArray[np.float64],
    up: NDArray[np.float64] | None,
    mount_height_m: float,
) -> NDArray[np.float64]:
    """Sensor poses (n, 4, 4) above floor points (n, 3), x along forward (n, 3).

    Args:
        up: (n, 3) normals of the floor. None where only the path knows its slope (stairs, level floors):
            then the robot pitches with the path and does not roll.
    """
    if up is None:
        left = np.column_stack([-forward[:, 1], forward[:, 0], np.zeros(len(forward))])
        left /= np.linalg.norm(left, axis=1, keepdims=True)
        up = np.cross(forward, left)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
    else:
        left = np.cross(up, forward)
        left /= np.linalg.norm(left, axis=1, keepdims=True)
    T = np.tile(np.eye(4), (len(floor), 1, 1))
    T[:, :3, 0] = np.cross(left, up)
    T[:, :3, 1] = left
    T[:, :3, 2] = up
    T[:, :3, 3] = floor + up * mount_height_m
    return T
