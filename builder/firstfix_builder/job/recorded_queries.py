"""Choice of the recorded queries that a patch looks at: of all days and robots, near changes first."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Verdict
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from firstfix.engine.changes.areas import Area
from firstfix.engine.changes.cells import spot_of
from firstfix.store.json_record import read_each

MIN_PROBABILITY = 0.99  # as for the counts of changes: a wrong pose would contradict the whole map around it
MAX_DAYS = 14
MAX_READ = 4000  # records, as many of each day
MAX_QUERIES = 600  # as many of each day; no robot has more than half of a day's
NEAR_M = 15.0  # from an area that seems changed: queries from there come first
HOUR_S = 3600.0


@dataclass(frozen=True)
class RobotQuery:
    """A localized query of a robot.

    Attributes:
        time_s: of its answer, seconds since 1970.
        position_m: (3,) of the sensor in the map's frame.
    """

    recorded: RecordedQuery
    time_s: float
    position_m: NDArray[np.float64]


def chosen_queries(
    recorded_queries: RecordedQueries,
    map_id: str,
    version: str,
    areas: Sequence[Area],
    on_progress: Callable[[float], None] = lambda done: None,
) -> list[RobotQuery]:
    """The queries to look at, the oldest first.

    They are chosen by time, robot and place, and never by what they show: the choice favours no side.

    Args:
        version: that has answered them.
        areas: that seem changed.
        on_progress: called with the share of the days that is read, 0..1.
    """
    of_day: dict[str, list[str]] = defaultdict(list)
    for query_id in recorded_queries.ids():
        of_day[query_id[:8]].append(query_id)
    days = sorted(of_day)[-MAX_DAYS:]
    found: list[RobotQuery] = []
    for number, day in enumerate(days):
        on_progress(number / len(days))
        some = [of_day[day][row] for row in rows_by_chance(len(of_day[day]), MAX_READ // len(days))]
        read = [
            _query_of(recorded, map_id, version)
            for recorded in read_each(some, recorded_queries.find).values()
        ]
        found += _of_day([one for one in read if one is not None], areas, MAX_QUERIES // len(days))
    return sorted(found, key=lambda one: (one.time_s, one.recorded.query_id))


def _query_of(recorded: RecordedQuery | None, map_id: str, version: str) -> RobotQuery | None:
    """The query of a record; None: it does not count."""
    if recorded is None or not recorded.robot:
        return None
    try:
        answer = Localization.from_mapping(recorded.answer)
        time_s = datetime.fromisoformat(recorded.time).timestamp()
    except (ValueError, KeyError, TypeError):
        return None  # of another release
    T_map_sensor = answer.T_map_sensor
    if (
        (answer.map_id, answer.map_version) != (map_id, version)
        or answer.verdict is not Verdict.LOCALIZED
        or answer.probability < MIN_PROBABILITY
        or T_map_sensor is None
        or not np.isfinite(T_map_sensor).all()
    ):
        return None
    return RobotQuery(recorded, time_s, T_map_sensor[:3, 3])


def _of_day(queries: Sequence[RobotQuery], areas: Sequence[Area], most: int) -> list[RobotQuery]:
    """Equal parts of all robots: of each one query in an hour from each place of 1 m."""
    told, of_robot = set(), defaultdict[str, list[RobotQuery]](list)
    for one in queries:
        place = one.recorded.robot, spot_of(one.position_m), int(one.time_s // HOUR_S)
        if place not in told:
            told.add(place)
            of_robot[one.recorded.robot].append(one)
    limit = max(most // max(len(of_robot), 2), 1)
    found: list[RobotQuery] = []
    for _, each in sorted(of_robot.items()):
        near = [_is_near(one.position_m, areas) for one in each]
        first = _some([one for one, is_near in zip(each, near, strict=True) if is_near], limit)
        rest = [one for one, is_near in zip(each, near, strict=True) if not is_near]
        found += first + _some(rest, limit - len(first))
    return found


def _some(queries: list[RobotQuery], most: int) -> list[RobotQuery]:
    return [queries[row] for row in rows_by_chance(len(queries), most)] if most else []


def _is_near(position_m: NDArray[np.float64], areas: Sequence[Area]) -> bool:
    """Whether a place is within sight of an area."""
    for area in areas:
        low_m, high_m = area.box_m
        beyond_m = np.maximum(np.maximum(low_m - position_m, position_m - high_m), 0)
        if np.linalg.norm(beyond_m) <= NEAR_M:
            return True
    return False
