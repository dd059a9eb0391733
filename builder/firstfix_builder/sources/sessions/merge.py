"""Places all sessions of a folder, and merges their clouds into one map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.errors import BuildFailed
from firstfix.transform import Matrix, inverse, transform_points

from ...mesh.intensity import Intensity, joined_intensity
from ...simulation.simulate import Simulator
from .description import Session
from .place_session import NotPlaced, place_session
from .session_map import PlacedSession, SessionMap

FAR_FROM_SURFACE_M = 0.3  # points nearer to the later session's surface are still there
SIGHT_M = 15.0
BEHIND_M = 0.3  # the surface that the ray meets is at least this far behind the point
WITNESSES = 6  # nearest sensor positions of the later run, from which a point is looked at
MIN_WITNESSES = 2  # of these that must have seen through it
PLACE_STEP_M = 0.5
_AT_ONCE = 200_000


def seen_through(
    points: NDArray[np.float64], simulator: Simulator, trajectory: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """For each of (n, 3) earlier points whether the later session saw through it.

    Only the sensor positions of the later run count: nothing is known about the view from other places.

    Args:
        simulator: mesh of the later session, in whose frame all arguments are.
        trajectory: (m, 4, 4) of the later session's sensor.
    """
    gone = np.zeros(len(points), np.bool_)
    places = _thinned(trajectory[:, :3, 3])
    tree = cKDTree(places)
    for start in range(0, len(points), _AT_ONCE):
        part = points[start : start + _AT_ONCE]
        rows = np.flatnonzero(tree.query(part, distance_upper_bound=SIGHT_M)[0] < SIGHT_M)
        rows = rows[simulator.distance(part[rows]) > FAR_FROM_SURFACE_M] if len(rows) else rows
        if len(rows):
            gone[start + rows] = _witnesses(part[rows], simulator, places, tree) >= MIN_WITNESSES
    return gone


def _witnesses(
    points: NDArray[np.float64], simulator: Simulator, places: NDArray[np.float64], tree: cKDTree
) -> NDArray[np.int64]:
    """(n,) number of places from which a surface was seen behind each point."""
    away_m, nearest = tree.query(points, k=list(range(1, min(WITNESSES, len(places)) + 1)))
    count = np.zeros(len(points), np.int64)
    for column in range(nearest.shape[1]):
        within = np.flatnonzero((away_m[:, column] < SIGHT_M) & (away_m[:, column] > 0))
        if len(within):
            origins, range_m = places[nearest[within, column]], away_m[within, column]
            hit_m = simulator.cast(origins, (points[within] - origins) / range_m[:, None])
            count[within] += np.isfinite(hit_m) & (hit_m > range_m + BEHIND_M)
    return count


def _thinned(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """One position for each half metre: a robot that stood still counts once."""
    _, first = np.unique(np.floor(positions / PLACE_STEP_M), axis=0, return_index=True)
    return positions[np.sort(first)]


@dataclass(frozen=True)
class ReadSession:
    """A session after reading, in its levelled frame.

    Attributes:
        points: (n, 3) its cleaned cloud.
        trajectory: (m, 4, 4) of the sensor, or None.
        T_session_level: (4, 4) to the coordinates of its file.
        intensity: of the points; None: they have none.
    """

    session: Session
    points: NDArray[np.float64]
    trajectory: NDArray[np.float64] | None
    T_session_level: Matrix
    intensity: Intensity | None = None


@dataclass(frozen=True)
class MergedSessions:
    """Sessions as one map, in the levelled frame of the first.

    Attributes:
        points: (n, 3) of all sessions, without those that a later session saw through.
        trajectory: (m, 4, 4) of all sessions that have one, in their order, or None.
        T_map_first: (4, 4) to the map's coordinates.
        record: for the version's manifest, one entry for each session.
        intensity: of the points; None: a session has none.
    """

    points: NDArray[np.float64]
    trajectory: NDArray[np.float64] | None
    T_map_first: Matrix
    record: list[dict[str, Any]]
    intensity: Intensity | None


def merge(
    read: Sequence[ReadSession],
    map_of: Callable[[int], SessionMap],
    simulator_of: Callable[[int], Simulator],
    executor: Executor,
    placed_one: Callable[[], None],
    cancelled: Callable[[], bool],
) -> MergedSessions:
    """Merge two or more sessions.

    A session without a given transform is aligned with the placed ones. A session that cannot be placed is
    tried again after the others.

    Args:
        map_of: makes the index of a session, by its number; called only where an index is needed.
        simulator_of: makes the mesh of a session, which is less work.
        placed_one: called after each session that was aligned.

    Raises:
        BuildFailed: a session cannot be placed; the message has its name and the reason.
        BuildCancelled: cancelled() said so.
    """
    first = read[0]
    T_map_first = (np.eye(4) if first.session.given is None else first.session.given) @ first.T_session_level
    T: dict[int, Matrix] = {0: np.eye(4)}
    evidence: dict[int, dict[str, Any]] = {}
    for number, one in enumerate(read[1:], start=1):
        if one.session.given is not None:
            T[number] = inverse(T_map_first) @ one.session.given @ one.T_session_level
    reasons: dict[int, str] = {}
    missing = [number for number in range(len(read)) if number not in T]
    while missing:
        for number in missing:
            placed = [PlacedSession(map_of(other), T[other]) for other in sorted(T)]
            found = place_session(map_of(number), placed, executor, cancelled)
            if isinstance(found, NotPlaced):
                reasons[number] = found.reason
            else:
                T[number], evidence[number] = found.T_first_session, found.evidence
                placed_one()
        left = [number for number in missing if number not in T]
        if len(left) == len(missing):
            break
        missing = left
    if missing:
        raise BuildFailed(
            "; ".join(f"session {read[n].session.source} cannot be placed: {reasons[n]}" for n in missing)
        )
    return _together(read, T, T_map_first, evidence, simulator_of)


def _together(
    read: Sequence[ReadSession],
    T: dict[int, Matrix],
    T_map_first: Matrix,
    evidence: dict[int, dict[str, Any]],
    simulator_of: Callable[[int], Simulator],
) -> MergedSessions:
    clouds = [transform_points(T[number], one.points) for number, one in enumerate(read)]
    brightness = [one.intensity for one in read]
    removed = [0] * len(read)
    for number, one in enumerate(read[1:], start=1):
        if one.trajectory is None:
            continue  # the sensor positions are not known
        for earlier in range(number):
            cloud = transform_points(inverse(T[number]), clouds[earlier])
            gone = seen_through(cloud, simulator_of(number), one.trajectory)
            clouds[earlier] = clouds[earlier][~gone]
            bright = brightness[earlier]
            brightness[earlier] = None if bright is None else bright.at(~gone)
            removed[earlier] += int(gone.sum())
    trajectories = [T[n] @ one.trajectory for n, one in enumerate(read) if one.trajectory is not None]
    record = []
    for number, one in enumerate(read):
        T_map_session = T_map_first @ T[number] @ inverse(one.T_session_level)
        record.append(
            {
                "source": one.session.source,
                "T_map_session": np.round(T_map_session, 6).tolist(),
                "aligned": number in evidence,
                "points": len(one.points),
                "removed_points": removed[number],
                "evidence": evidence.get(number),
            }
        )
    trajectory = np.concatenate(trajectories) if trajectories else None
    return MergedSessions(
        np.concatenate(clouds), trajectory, T_map_first, record, joined_intensity(brightness)
    )
