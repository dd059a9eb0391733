"""Compares two aligned sessions: whether they show the same place, and whether either of them is bent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.scan.reduction import voxel_means
from firstfix.transform import Matrix, inverse

from ...simulation.rays import Rays
from ...simulation.simulate import upright
from ...viewpoints.even_sample import rows_by_place
from .ask_places import moved, scan_at
from .session_map import SessionMap

SHARED_WITHIN_M = 2.0  # a place so near to a place of the other session is in both
PLACES = 40
PLACE_M = 2.0
SIGHT_M = 20.0  # longer rays show where a session ends rather than the place
SAME_M, SAME_PER_M = 0.2, 0.01  # difference of two ranges to the same surface, at most
PATCH_VOXEL_M = 0.15
MIN_PATCH_POINTS, MIN_MAPPED = 300, 0.7  # points seen from a place that both have: number, and share
HELD_PAIRS, HELD_ARM_M = 50.0, 3.0  # pairs that fix a direction; about an axis, their distance from it


@dataclass(frozen=True)
class SharedPlace:
    """A place that both sessions saw, and a comparison of their views from it.

    Attributes:
        position_m: (3,) in the session that was placed.
        rays: number of rays that meet a surface in both sessions.
        same: 0..1, share of these that meet the same surface.
        movable: number of rays to movable objects that both have, and to things that only one has.
        offset: offset of the surfaces around the place, in metres and in degrees; None: too little of them is
            in both sessions.
    """

    position_m: NDArray[np.float64]
    rays: int
    same: float
    movable: tuple[int, int]
    offset: tuple[float, float] | None


def shared_places(
    placed: SessionMap, grids: MapSurface, known: SessionMap, T_known_placed: Matrix
) -> list[SharedPlace]:
    """Compare the simulated views of two sessions from places that are in both.

    Args:
        grids: surface of the known session.
    """
    rows = rows_in_both(placed.position_m, known, T_known_placed)
    rows = rows[rows_by_place(placed.position_m[rows], PLACES, PLACE_M)]
    rays = Rays.at_any_heading(placed.sensor)
    found = []
    for position_m, height_m in zip(placed.position_m[rows], placed.height_m[rows], strict=True):
        T_placed_sensor = upright(position_m[None])[0]
        T_known_sensor = T_known_placed @ T_placed_sensor
        here = next(placed.simulator.ranges(T_placed_sensor[None], placed.sensor, rays))[0]
        there = next(known.simulator.ranges(T_known_sensor[None], known.sensor, rays))[0]
        both = np.isfinite(here) & np.isfinite(there) & (np.minimum(here, there) < SIGHT_M)
        if not both.any():
            continue
        here, there, seen = here[both], there[both], rays.directions[both].astype(np.float64)
        same = np.abs(here - there) <= SAME_M + SAME_PER_M * here
        # where only one session has a thing, the nearer surface is the thing
        points = position_m + np.minimum(here, there)[:, None] * seen
        floor_z = position_m[2] - height_m
        floor_known_z = moved(T_known_placed, np.array([*position_m[:2], floor_z]))[2]
        thing = np.where(
            here <= there,
            placed.movable_objects.among(points, floor_z),
            known.movable_objects.among(moved(T_known_placed, points), floor_known_z),
        )
        offset = _offset(scan_at(placed, T_placed_sensor), grids, T_known_sensor)
        movable = int((thing & same).sum()), int((thing & ~same).sum())
        found.append(SharedPlace(position_m, len(same), float(same.mean()), movable, offset))
    return found


def rows_in_both(
    position_m: NDArray[np.float64], known: SessionMap, T_known_placed: Matrix
) -> NDArray[np.int64]:
    """Rows of the (n, 3) positions that are near a place of the known session."""
    away_m, _ = cKDTree(known.position_m).query(
        moved(T_known_placed, position_m), distance_upper_bound=SHARED_WITHIN_M
    )
    return np.flatnonzero(np.isfinite(away_m))


def _offset(
    points: NDArray[np.float32], grids: MapSurface, T_known_sensor: Matrix
) -> tuple[float, float] | None:
    """Correction that aligns the points seen from a place with the known surface, in metres and degrees.

    Directions that the surface does not fix, such as along a corridor, do not count. None: the known session
    saw too little of these points.
    """
    near = voxel_means(points[np.linalg.norm(points, axis=1) < SIGHT_M], PATCH_VOXEL_M)
    at = moved(T_known_sensor, near) - grids.coarse.corner
    mapped = near[grids.coarse.nearest(at.astype(np.float32)) >= 0]
    if len(mapped) < max(MIN_PATCH_POINTS, MIN_MAPPED * len(near)):
        return None
    scan = Surface.around(mapped, -mapped)
    found = grids.align_fine(scan, grids.align_smoothly(scan, T_known_sensor[None]).T_level_sensor)[0]
    T = found.T_level_sensor @ inverse(T_known_sensor)
    shift_m = found.T_level_sensor[:3, 3] - T_known_sensor[:3, 3]  # about the sensor, as the information is
    turn_rad = np.array([T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1]]) / 2
    offset_m = _held(shift_m, found.information[3:, 3:], HELD_PAIRS)
    offset_rad = _held(turn_rad, found.information[:3, :3], HELD_PAIRS * HELD_ARM_M**2)
    return offset_m, float(np.degrees(offset_rad))


def _held(step: NDArray[np.float64], information: NDArray[np.float64], strength: float) -> float:
    """Length of a correction in the directions that the surface fixes with at least this strength."""
    values, vectors = np.linalg.eigh(information)
    return float(np.linalg.norm(vectors[:, values >= strength].T @ step))
