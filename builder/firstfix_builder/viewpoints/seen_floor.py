"""Floor that no step reaches from the trajectory, but that the mapping run saw (docs/method.md section 1)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..simulation.simulate import Simulator
from .even_sample import FloorPoints
from .joined_parts import JoinedParts

SPARSE_M = 2.0  # between neighbouring poses: more than the keyframes of a run that drove or walked
STOP_M = 0.5  # scans nearer to each other than this are of one stop
SIGHT_M = 30.0  # a level floor further away than this is seen by few rays
LIFT_M = 0.3  # over the floor, so that its bumps do not hide it
POSE_STEP_M = 4.0
MAX_POSES = 12  # nearest poses, from which a place is looked at
MIN_M2 = 4.0  # of a floor: more than a table or the roof of a car

TileFloor: TypeAlias = tuple[tuple[int, int], NDArray[np.float64]]
Kept: TypeAlias = Callable[[int], tuple[FloorPoints, NDArray[np.int32]]]


@dataclass(frozen=True)
class MappingRun:
    """The run that a map was made from.

    Attributes:
        is_sparse: it stopped and went, so its way does not say where a robot can be.
        sees: yields for each tile with (n, 3) places on its floor, (n,) whether the run saw them.
    """

    is_sparse: bool
    sees: Callable[[Sequence[TileFloor]], Iterator[NDArray[np.bool_]]]


def is_sparse(positions: NDArray[np.float64]) -> bool:
    """Whether the median distance between neighbours of (m, 3) poses is over SPARSE_M."""
    stops = one_of_each(positions, STOP_M)
    if len(stops) < 2:
        return True
    return bool(np.median(cKDTree(stops).query(stops, k=2)[0][:, 1]) > SPARSE_M)


def one_of_each(positions: NDArray[np.float64], cube_m: float) -> NDArray[np.float64]:
    """The first of (m, 3) positions in each cube, in their order. Cubes are counted from the origin."""
    _, first = np.unique(np.floor(positions / cube_m), axis=0, return_index=True)
    return positions[np.sort(first)]


def poses_near(
    positions: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(k, 3) poses that the floor in the box of (2,) corners is looked at from."""
    near = ((positions[:, :2] >= low - SIGHT_M) & (positions[:, :2] < high + SIGHT_M)).all(axis=1)
    return one_of_each(positions[near], POSE_STEP_M)


def seen_from(
    simulator: Simulator, floor: NDArray[np.float64], poses: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n,) whether one of (k, 3) poses looks down on each of (n, 3) places of a floor, and nothing hides it.

    A ceiling, seen from below, looks like a floor from above: nobody has looked down on it.
    """
    seen = np.zeros(len(floor), np.bool_)
    if not len(poses) or not len(floor):
        return seen
    places = floor + [0.0, 0.0, LIFT_M]
    nearest = list(range(1, min(MAX_POSES, len(poses)) + 1))
    away_m, number = cKDTree(poses).query(places, k=nearest, distance_upper_bound=SIGHT_M)
    for column in range(len(nearest)):
        ask = np.flatnonzero(np.isfinite(away_m[:, column]) & ~seen)
        pose = poses[number[ask, column]]
        above = pose[:, 2] > places[ask, 2]
        ask, pose = ask[above], pose[above]
        if len(ask):
            seen[ask] = simulator.is_way_free(pose, places[ask])
    return seen


def seen_beyond(
    tiles: Sequence[tuple[int, int]],
    cell_m: float,
    parts: JoinedParts,
    chosen: NDArray[np.bool_],
    kept: Kept,
    mapping: MappingRun,
) -> dict[int, NDArray[np.bool_]]:
    """By a tile's number which of its floor points the mapping run saw on floors that no step reaches.

    Floors count of which it saw MIN_M2 or more.

    Args:
        parts, chosen: the parts of all tiles, and those that steps reach.
        kept: returns a tile's points with their parts.
    """
    floor = parts.floor_of
    area_m2 = np.bincount(floor, parts.cells * cell_m**2)
    is_wide = area_m2 >= MIN_M2
    is_wide[floor[chosen]] = False
    rows: dict[int, NDArray[np.int64]] = {}
    asked: list[TileFloor] = []
    for number, tile in enumerate(tiles):
        here = floor[parts.parts_of(number)]
        if is_wide[here].any():
            points, part = kept(number)
            rows[number] = np.flatnonzero(is_wide[here[part]])
            asked.append((tile, np.column_stack([points.xy_m, points.z])[rows[number]]))
    of_rows = {number: floor[parts.parts_of(number)][kept(number)[1][at]] for number, at in rows.items()}
    saw = dict(zip(rows, mapping.sees(asked), strict=True))
    count = np.zeros((2, len(area_m2)))  # places asked, and of them seen
    for number, of in of_rows.items():
        count += [np.bincount(some, minlength=len(area_m2)) for some in (of, of[saw[number]])]
    is_wide &= area_m2 * count[1] >= MIN_M2 * count[0]
    found = {}
    for number, at in rows.items():
        found[number] = np.zeros(len(kept(number)[1]), np.bool_)
        found[number][at[saw[number] & is_wide[of_rows[number]]]] = True
    return found
