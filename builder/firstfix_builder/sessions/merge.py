"""Places all sessions of a folder, and merges their clouds into one map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import BuildFailed
from firstfix.transform import Matrix, inverse, transform_points

from ..simulation.simulate import Simulator
from .description import Session
from .place_session import NotPlaced, place_session
from .seen_through import seen_through
from .session_map import PlacedSession, SessionMap


@dataclass(frozen=True)
class ReadSession:
    """A session after reading, in its levelled frame.

    Attributes:
        points: (n, 3) its cleaned cloud.
        trajectory: (m, 4, 4) of the sensor, or None.
        T_session_level: (4, 4) to the coordinates of its file.
    """

    session: Session
    points: NDArray[np.float64]
    trajectory: NDArray[np.float64] | None
    T_session_level: Matrix


@dataclass(frozen=True)
class MergedSessions:
    """Sessions as one map, in the levelled frame of the first.

    Attributes:
        points: (n, 3) of all sessions, without those that a later session saw through.
        trajectory: (m, 4, 4) of all sessions that have one, in their order, or None.
        T_map_first: (4, 4) to the map's coordinates.
        record: for the version's manifest, one entry for each session.
    """

    points: NDArray[np.float64]
    trajectory: NDArray[np.float64] | None
    T_map_first: Matrix
    record: list[dict[str, Any]]


def merge(
    read: Sequence[ReadSession],
    map_of: Callable[[int], SessionMap],
    simulator_of: Callable[[int], Simulator],
    executor: Executor,
    placed_one: Callable[[], None],
    cancelled: Callable[[], bool],
) -> MergedSessions:
    """Merges two or more sessions.

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
    removed = [0] * len(read)
    for number, one in enumerate(read[1:], start=1):
        if one.trajectory is None:
            continue  # the sensor positions are not known
        for earlier in range(number):
            cloud = transform_points(inverse(T[number]), clouds[earlier])
            gone = seen_through(cloud, simulator_of(number), one.trajectory)
            clouds[earlier] = clouds[earlier][~gone]
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
    return MergedSessions(np.concatenate(clouds), trajectory, T_map_first, record)
