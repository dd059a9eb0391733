"""Maps and poses that are not what they seem: each made of a right map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from firstfix.transform import make_transform, rotation_z, transform_points
from firstfix_cli.limited_reader import read_scan

from .places import RECORDED, PlaceMap

Change = Callable[[PlaceMap], PlaceMap]
SEEN_M = 15.0  # from the way: what its scans show again
POSES_NEAR = 12  # tell the ground's height, or that of two storeys


def without_poses(right: PlaceMap) -> PlaceMap:
    """The map alone."""
    return replace(right, poses=right.poses[:0])


def sunk(by_m: float, *, keeps_poses: bool = True) -> Change:
    """The way back again, and what it shows, ever deeper below the way there: a loop that was left open."""

    def change(right: PlaceMap) -> PlaceMap:
        deep_m = by_m * np.linspace(1, 0, len(right.poses))
        back = right.poses.copy()
        back[:, 2, 3] -= deep_m
        away_m, nearest = cKDTree(right.poses[:, :2, 3]).query(right.points[:, :2])
        seen = away_m < SEEN_M
        again = right.points[seen].copy()
        again[:, 2] -= deep_m[nearest[seen]]
        poses = np.concatenate([right.poses, back[::-1]]) if keeps_poses else right.poses[:0]
        return replace(right, points=np.concatenate([right.points, again]), poses=poses)

    return change


def leaning(lean_deg: float, direction_deg: float) -> Change:
    """The trajectory, rising in one direction: the map was levelled and the poses were not."""

    def change(right: PlaceMap) -> PlaceMap:
        to_x = rotation_z(np.radians(-direction_deg))
        c, s = np.cos(np.radians(lean_deg)), np.sin(np.radians(lean_deg))
        R = to_x.T @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ to_x
        middle = right.poses[:, :3, 3].mean(axis=0)
        T = make_transform(R, middle - R @ middle)
        return replace(right, poses=T @ right.poses)

    return change


def at_heights(sensor_m: float, over_m: float) -> Change:
    """The poses over the floor at another height than the sensor's."""

    def change(right: PlaceMap) -> PlaceMap:
        poses = right.poses.copy()
        poses[:, 2, 3] += over_m - sensor_m
        return replace(right, poses=poses)

    return change


def without_ground(sensor_m: float, over_m: float, *, keeps_poses: bool = True) -> Change:
    """The map without the points near the ground or below it, whose height the poses near by tell."""

    def change(right: PlaceMap) -> PlaceMap:
        at = right.poses[:, :3, 3]
        _, nearest = cKDTree(at[:, :2]).query(right.points[:, :2], min(POSES_NEAR, len(at)))
        over_ground_m = right.points[:, 2, None] - at[nearest, 2] + sensor_m  # of each storey near
        kept = (np.abs(over_ground_m) > over_m).all(axis=1) & (over_ground_m > 0).any(axis=1)
        return replace(
            right, points=right.points[kept], poses=right.poses if keeps_poses else right.poses[:0]
        )

    return change


def written_with(digits: int, far_m: float) -> Change:
    """The map far from its origin, as text with so many digits: a stream of C++ writes six by itself."""

    def change(right: PlaceMap) -> PlaceMap:
        shift_m = np.array([far_m, 2 * far_m, 0.0])
        points = right.points + shift_m
        size = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(points), 1e-9))) - digits + 1)
        poses = right.poses.copy()
        poses[:, :3, 3] += shift_m
        return replace(right, points=np.round(np.round(points / size) * size, 9), poses=poses)

    return change


def rounded(step_m: float) -> Change:
    """The map on steps, as a LAS file with a coarse scale has it."""

    def change(right: PlaceMap) -> PlaceMap:
        return replace(right, points=np.round(right.points / step_m) * step_m)

    return change


def of_one_scan(number: int, moved: bool) -> Change:
    """One of the place's recorded scans in place of the map, in its own frame or in another."""

    def change(right: PlaceMap) -> PlaceMap:
        place = next(one for one in RECORDED.values() if one.config == right.config)
        scans = sorted(path for path in (place.path / "queries").iterdir() if path.suffix != ".csv")
        points = read_scan(Path(scans[number])).points.astype(np.float64)
        T = make_transform(rotation_z(2.0), np.array([30.0, -12.0, 2.0])) if moved else np.eye(4)
        return replace(right, points=transform_points(T, points), poses=right.poses[:0])

    return change
