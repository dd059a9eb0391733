"""Confirmed queries: recorded queries whose places are told, or tracked. The self-test of a build asks them.

People tell a place, or the robot's own motion does (``tracked_queries``). What people tell comes first.

Their folder:

confirmed.json    ``ConfirmedQueries``
queries/<id>      bodies of the queries, as they came
"""

from __future__ import annotations

import json
import logging
import shutil
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.catalog.recorded_queries import TOLD_AT, TOLD_BY, RecordedQueries, RecordedQuery
from firstfix.engine.changes.cells import Spot, spot_of
from firstfix.errors import NotFound, StoreError, UnreadableRecord
from firstfix.store.json_record import read_each
from firstfix.transform import pose_from_mapping

from .tracked_queries import tracked_queries

_log = logging.getLogger(__name__)
CONFIRMED_FILE = "confirmed.json"
MAX_AGE_DAYS = 90  # a place changes
MAX_READ = 4000  # records; those with a truth are read first
MAX_BODY_BYTES = 64 << 20
MAX_OF_ROBOT, MAX_OF_HOUR = 2, 4  # one robot has at most half of the queries, one hour a quarter
PLACE_M = 5.0
HOUR_S, DAY_S = 3600.0, 86400.0
SEED = 17
ASKED_WITH = ("gravity", "T_base_sensor", "twist")  # options about the scan; a prior would help it


@dataclass(frozen=True)
class ConfirmedQuery:
    """A recorded query with the place where it was taken, without its body.

    Attributes:
        file: path of the body below the folder.
        robot: pseudonym of its credential; empty if it had none.
        time_s: of its answer, seconds since 1970.
        T_map_sensor: the place, in the form of ``pose_to_mapping``.
        options: that it was asked with, of those in ASKED_WITH.
        told_by, told_at: who has told the place, and when; empty if nobody can tell. TRACKING: the robot's
            motion.
    """

    file: str
    robot: str
    time_s: float
    media_type: str
    content_encoding: str
    T_map_sensor: Mapping[str, Any]
    options: Mapping[str, str]
    told_by: str = ""
    told_at: str = ""


@dataclass(frozen=True)
class ConfirmedQueries:
    """Content of ``confirmed.json``.

    Attributes:
        queries: those that are asked. Neighbours in space are neighbours here.
        left_out: reasons against all others, by the recorded query's id, or by how many there are.
    """

    queries: tuple[ConfirmedQuery, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)

    def save(self, folder: Path) -> None:
        """Write ``confirmed.json``."""
        (folder / CONFIRMED_FILE).write_text(json.dumps(asdict(self), sort_keys=True))

    @classmethod
    def load(cls, folder: Path) -> ConfirmedQueries:
        """Read what ``save`` wrote."""
        found = json.loads((folder / CONFIRMED_FILE).read_text())
        return cls(**{**found, "queries": tuple(ConfirmedQuery(**one) for one in found["queries"])})


@dataclass(frozen=True)
class _Told:
    """A recorded query with a truth in the map."""

    recorded: RecordedQuery
    time_s: float
    position_m: NDArray[np.float64]

    @property
    def hour(self) -> int:
        return int(self.time_s // HOUR_S)

    @property
    def place(self) -> tuple[int, ...]:
        x, y, z = np.floor(self.position_m / PLACE_M).astype(int).tolist()
        return x, y, z


def collect_confirmed(recorded_queries: RecordedQueries, map_id: str, most: int, folder: Path) -> Path | None:
    """Make the folder. Returns it; None if no recorded query of the map is confirmed.

    A store of recorded queries that fails stops no build: the folder then has the reason.

    Args:
        most: number of queries to take.
    """
    shutil.rmtree(folder, ignore_errors=True)
    if not most:
        return None
    try:
        read = read_each(recorded_queries.ids_told_first()[:MAX_READ], recorded_queries.find)
        kept = [recorded for recorded in read.values() if recorded is not None]
        untold = [recorded for recorded in kept if not recorded.truth]
        told = [
            one
            for one in (_told_in(recorded, map_id) for recorded in (*kept, *tracked_queries(untold, map_id)))
            if one is not None
        ]
        if not told:
            return None
        (folder / "queries").mkdir(parents=True)
        found = _fetched(recorded_queries, told, most, folder)
    except StoreError as error:
        _log.warning("confirmed queries cannot be read: %s", error)
        folder.mkdir(parents=True, exist_ok=True)
        found = ConfirmedQueries(left_out={"confirmed queries": f"they cannot be read: {error}"})
    found.save(folder)
    return folder


def _told_in(recorded: RecordedQuery, map_id: str) -> _Told | None:
    """The query of a record; None: nobody has told a place in this map."""
    if recorded.truth.get("map_id") != map_id or not recorded.truth.get("T_map_sensor"):
        return None
    try:
        T_map_sensor = pose_from_mapping(recorded.truth["T_map_sensor"])
        time_s = datetime.fromisoformat(recorded.time).timestamp()
    except (ValueError, KeyError, TypeError):
        return None  # of another release
    return _Told(recorded, time_s, T_map_sensor[:3, 3]) if np.isfinite(T_map_sensor).all() else None


def drawn(told: Sequence[_Told], most: int) -> list[_Told]:
    """So many of the queries, by seeded chance and spread over places. Neighbours in space are neighbours.

    Of each robot one in an hour from a place of 1 m. Each place of PLACE_M gives one before any gives two. No
    robot and no hour has more than its part: time, robot and place choose, and never what a query shows.
    """
    ordered = sorted(told, key=lambda one: one.recorded.query_id)
    by_chance = [ordered[row] for row in np.random.default_rng(SEED).permutation(len(ordered)).tolist()]
    told_before: set[tuple[str, int, Spot]] = set()
    turn: Counter[tuple[int, ...]] = Counter()
    turns: list[tuple[int, _Told]] = []
    for one in by_chance:
        again = one.recorded.robot, one.hour, spot_of(one.position_m)
        if again not in told_before:
            told_before.add(again)
            turns.append((turn[one.place], one))
            turn[one.place] += 1
    of_robot: Counter[str] = Counter()
    of_hour: Counter[int] = Counter()
    found: list[_Told] = []
    for _, one in sorted(turns, key=lambda pair: pair[0]):
        if len(found) == most:
            break
        if (
            of_robot[one.recorded.robot] < _part(most, MAX_OF_ROBOT)
            and of_hour[one.hour] < _part(most, MAX_OF_HOUR)
        ):  # fmt: skip
            of_robot[one.recorded.robot] += 1
            of_hour[one.hour] += 1
            found.append(one)
    return sorted(found, key=lambda one: (one.place, one.recorded.query_id))


def _fetched(
    recorded_queries: RecordedQueries, told: Sequence[_Told], most: int, folder: Path
) -> ConfirmedQueries:
    oldest_s = time.time() - MAX_AGE_DAYS * DAY_S
    young = [one for one in told if one.time_s >= oldest_s]
    chosen = drawn(young, most)
    queries, left_out = [], {}
    if len(told) > len(young):
        left_out[f"{len(told) - len(young)} confirmed queries"] = f"older than {MAX_AGE_DAYS} days"
    if len(young) > len(chosen):
        left_out[f"{len(young) - len(chosen)} more confirmed queries"] = (
            f"not drawn: at most {most} are asked, {_part(most, MAX_OF_ROBOT)} of one robot, "
            f"{_part(most, MAX_OF_HOUR)} of one hour"
        )
    for one in chosen:
        recorded = one.recorded
        file = f"queries/{recorded.query_id}"
        try:
            if recorded.body_bytes > MAX_BODY_BYTES:
                raise UnreadableRecord(f"its body has {recorded.body_bytes} bytes")
            (folder / file).write_bytes(recorded_queries.body(recorded.query_id))
        except (NotFound, UnreadableRecord) as error:
            left_out[recorded.query_id] = str(error)
            continue
        queries.append(
            ConfirmedQuery(
                file,
                recorded.robot,
                one.time_s,
                recorded.media_type,
                recorded.content_encoding,
                recorded.truth["T_map_sensor"],
                {name: recorded.options[name] for name in ASKED_WITH if name in recorded.options},
                str(recorded.truth.get(TOLD_BY, "")),
                str(recorded.truth.get(TOLD_AT, "")),
            )
        )
    return ConfirmedQueries(tuple(queries), left_out)


def _part(most: int, parts: int) -> int:
    return max(most // parts, 1)
