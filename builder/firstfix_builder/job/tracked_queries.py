"""Recorded queries whose places a robot's own motion confirms.

Two fixes of one robot, a minute or more apart and at different places, confirm each other if the motion
between them is that of the robot's odometry. Each was searched for in the whole map, so a wrong place would
have to repeat itself, with the same motion between. The queries between the two, which may not have been
localized, get their places by odometry.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.recorded_queries import TOLD_AT, TOLD_BY, RecordedQuery
from firstfix.errors import InvalidOption
from firstfix.transform import Matrix, inverse, pose_error, pose_from_mapping, pose_to_mapping

TRACKING = "tracking"  # in place of the name of who has told
MIN_S, MAX_S = 60.0, 600.0  # between two fixes: in less a wrong one may last, in more odometry drifts
MIN_MOVED_M = 5.0  # a robot that stands gets the same answer again, be it wrong
AGREE_M, AGREE_DEG = 0.5, 5.0  # odometry's drift; the self-test takes a place within 1 m for right


@dataclass(frozen=True)
class _Moved:
    """A query that knows the robot's odometry.

    Attributes:
        T_odom_sensor: (4, 4) pose of the sensor in the odometry's frame.
        T_map_sensor: (4, 4) of its answer; None: it was not localized in the map.
        is_free: the answer was searched for in the whole map, so it can confirm another one.
    """

    recorded: RecordedQuery
    time_s: float
    T_odom_sensor: Matrix
    T_map_sensor: Matrix | None
    is_free: bool

    def carried(self, to: _Moved) -> Matrix:
        """Pose (4, 4) in the map of another query's sensor: by this one's answer, and odometry."""
        assert self.T_map_sensor is not None
        return self.T_map_sensor @ inverse(self.T_odom_sensor) @ to.T_odom_sensor


@dataclass(frozen=True)
class _Place:
    """Pose (4, 4) of one query's sensor in the map, as a chain of fixes says it."""

    chain: int
    T_map_sensor: Matrix


def tracked_queries(recorded_queries: Iterable[RecordedQuery], map_id: str) -> list[RecordedQuery]:
    """The queries that are confirmed, with their places as truths that TRACKING has told.

    One whose place comes out differently by different fixes is left out.

    Args:
        recorded_queries: of any map and robot, in any order. Those of robots that cannot be told apart are
            not used.
    """
    of_robot: defaultdict[str, list[_Moved]] = defaultdict(list)
    for recorded in recorded_queries:
        if recorded.robot and recorded.is_about(map_id) and (moved := _moved(recorded, map_id)) is not None:
            of_robot[recorded.robot].append(moved)
    found: list[RecordedQuery] = []
    for queries in of_robot.values():
        queries.sort(key=lambda one: (one.time_s, one.recorded.query_id))
        found += _confirmed(queries, map_id)
    return found


def _confirmed(queries: Sequence[_Moved], map_id: str) -> Iterator[RecordedQuery]:
    """The confirmed ones among one robot's queries, which are sorted by time."""
    pairs = list(_pairs(queries))
    chain_of = _chains(pairs)
    places: defaultdict[int, list[_Place]] = defaultdict(list)
    for first, last in pairs:
        for row in range(first, last + 1):
            for T_map_sensor in _places_between(queries[first], queries[row], queries[last]):
                places[row].append(_Place(chain_of[first], T_map_sensor))
    doubted = {chain for found in places.values() for chain in _contradicting(found)}
    for row, found in places.items():
        query, nearest = queries[row], found[0].T_map_sensor
        own = query.T_map_sensor
        T = own if own is not None and _agree(own, nearest) else nearest
        if all(one.chain not in doubted and _agree(T, one.T_map_sensor) for one in found):
            at = datetime.fromisoformat(query.recorded.time).isoformat(timespec="seconds")
            truth = {"map_id": map_id, "T_map_sensor": pose_to_mapping(T), TOLD_BY: TRACKING, TOLD_AT: at}
            yield replace(query.recorded, truth=truth)


def _chains(pairs: Iterable[tuple[int, int]]) -> dict[int, int]:
    """The chain of each fix: fixes that confirm each other, directly or by others between, have one chain."""
    chain_of: dict[int, int] = {}
    for first, last in pairs:
        ours = chain_of.setdefault(first, first)
        theirs = chain_of.setdefault(last, ours)
        chain_of.update({row: ours for row, chain in chain_of.items() if chain == theirs})
    return chain_of


def _contradicting(places: Sequence[_Place]) -> set[int]:
    """Chains that put one query at different places: one of them repeats a wrong place, and either may."""
    return {
        one.chain
        for one in places
        for other in places
        if one.chain != other.chain and not _agree(one.T_map_sensor, other.T_map_sensor)
    }


def _pairs(queries: Sequence[_Moved]) -> Iterator[tuple[int, int]]:
    """Rows of each fix and of the next one that confirms it."""
    free = [row for row, query in enumerate(queries) if query.is_free]
    for at, first in enumerate(free):
        for last in free[at + 1 :]:
            apart_s = queries[last].time_s - queries[first].time_s
            if apart_s > MAX_S:
                break
            if apart_s >= MIN_S and _confirm(queries[first], queries[last]):
                yield first, last
                break


def _confirm(first: _Moved, last: _Moved) -> bool:
    expected = first.carried(last)
    assert first.T_map_sensor is not None
    assert last.T_map_sensor is not None
    moved_m = float(np.linalg.norm(expected[:3, 3] - first.T_map_sensor[:3, 3]))
    return moved_m >= MIN_MOVED_M and _agree(expected, last.T_map_sensor)


def _places_between(first: _Moved, query: _Moved, last: _Moved) -> list[Matrix]:
    """The query's place (4, 4) by both fixes: by the nearer one in time first."""
    by_first, by_last = first.carried(query), last.carried(query)
    if query.time_s - first.time_s <= last.time_s - query.time_s:
        return [by_first, by_last]
    return [by_last, by_first]


def _agree(T_map_a: Matrix, T_map_b: Matrix) -> bool:
    error_m, error_deg = pose_error(T_map_a, T_map_b)
    return error_m <= AGREE_M and error_deg <= AGREE_DEG


def _moved(recorded: RecordedQuery, map_id: str) -> _Moved | None:
    """The query with its odometry; None: it has none, or it is of another release."""
    try:
        options = LocalizeOptions.from_strings(recorded.options)
        time_s = datetime.fromisoformat(recorded.time).timestamp()
        localized = recorded.answer["verdict"] == Verdict.LOCALIZED.value
        is_here = localized and recorded.answer["map_id"] == map_id
        T_map_sensor = pose_from_mapping(recorded.answer["T_map_sensor"]) if is_here else None
    except (InvalidOption, ValueError, KeyError, TypeError):
        return None
    if options.T_odom_base is None:
        return None
    T_base_sensor = np.eye(4) if options.T_base_sensor is None else options.T_base_sensor
    is_free = T_map_sensor is not None and options.prior is None and bool(np.isfinite(T_map_sensor).all())
    return _Moved(recorded, time_s, options.T_odom_base @ T_base_sensor, T_map_sensor, is_free)
