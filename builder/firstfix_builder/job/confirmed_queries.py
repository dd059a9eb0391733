"""Confirmed queries: kept queries whose places are told, or tracked. The self-test of a build asks them.

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

from firstfix.catalog.recorded_queries import TOLD_AT, TOLD_BY, QuerySample, QuerySamples
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
    """A kept query with the place where it was taken, without its body.

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
        left_out: reasons against all others, by the sample's id, or by how many there are.
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
    """A kept query with a truth in the map."""

    sample: QuerySample
    time_s: float
    position_m: NDArray[np.float64]

    @property
    def hour(self) -> int:
        return int(self.time_s // HOUR_S)

    @property
    def place(self) -> tuple[int, ...]:
        x, y, z = np.floor(self.position_m / PLACE_M).astype(int).tolist()
        return x, y, z


def collect_confirmed(samples: QuerySamples, map_id: str, most: int, folder: Path) -> Path | None:
    """Make the folder. Returns it; None if no kept query of the map is confirmed.

    A store of kept queries that fails stops no build: the folder then has the reason.

    Args:
        most: number of queries to take.
    """
    shutil.rmtree(folder, ignore_errors=True)
    if not most:
        return None
    try:
        read = read_each(samples.ids_told_first()[:MAX_READ], samples.find)
        kept = [sample for sample in read.values() if sample is not None]
        untold = [sample for sample in kept if not sample.truth]
        told = [
            one
            for one in (_told_in(sample, map_id) for sample in (*kept, *tracked_queries(untold, map_id)))
            if one is not None
        ]
        if not told:
            return None
        (folder / "queries").mkdir(parents=True)
        found = _fetched(samples, told, most, folder)
    except StoreError as error:
        _log.warning("confirmed queries cannot be read: %s", error)
        folder.mkdir(parents=True, exist_ok=True)
        found = ConfirmedQueries(left_out={"confirmed queries": f"they cannot be read: {error}"})
    found.save(folder)
    return folder


def _told_in(sample: QuerySample, map_id: str) -> _Told | None:
    """The query of a record; None: nobody has told a place in this map."""
    if sample.truth.get("map_id") != map_id or not sample.truth.get("T_map_sensor"):
        return None
    try:
        T_map_sensor = pose_from_mapping(sample.truth["T_map_sensor"])
        time_s = datetime.fromisoformat(sample.time).timestamp()
    except (ValueError, KeyError, TypeError):
        return None  # of another release
    return _Told(sample, time_s, T_map_sensor[:3, 3]) if np.isfinite(T_map_sensor).all() else None


def drawn(told: Sequence[_Told], most: int) -> list[_Told]:
    """So many of the queries, by seeded chance and spread over places. Neighbours in space are neighbours.

    Of each robot one in an hour from a place of 1 m. Each place of PLACE_M gives one before any gives two. No
    robot and no hour has more than its part: time, robot and place choose, and never what a query shows.
    """
    ordered = sorted(told, key=lambda one: one.sample.sample_id)
    by_chance = [ordered[row] for row in np.random.default_rng(SEED).permutation(len(ordered)).tolist()]
    told_before: set[tuple[str, int, Spot]] = set()
    turn: Counter[tuple[int, ...]] = Counter()
    turns: list[tuple[int, _Told]] = []
    for one in by_chance:
        again = one.sample.robot, one.hour, spot_of(one.position_m)
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
            of_robot[one.sample.robot] < _part(most, MAX_OF_ROBOT)
            and of_hour[one.hour] < _part(most, MAX_OF_HOUR)
        ):  # fmt: skip
            of_robot[one.sample.robot] += 1
            of_hour[one.hour] += 1
            found.append(one)
    return sorted(found, key=lambda one: (one.place, one.sample.sample_id))


def _fetched(samples: QuerySamples, told: Sequence[_Told], most: int, folder: Path) -> ConfirmedQueries:
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
        sample = one.sample
        file = f"queries/{sample.sample_id}"
        try:
            if sample.body_bytes > MAX_BODY_BYTES:
                raise UnreadableRecord(f"its body has {sample.body_bytes} bytes")
            (folder / file).write_bytes(samples.body(sample.sample_id))
        except (NotFound, UnreadableRecord) as error:
            left_out[sample.sample_id] = str(error)
            continue
        queries.append(
            ConfirmedQuery(
                file,
                sample.robot,
                one.time_s,
                sample.media_type,
                sample.content_encoding,
                sample.truth["T_map_sensor"],
                {name: sample.options[name] for name in ASKED_WITH if name in sample.options},
                str(sample.truth.get(TOLD_BY, "")),
                str(sample.truth.get(TOLD_AT, "")),
            )
        )
    return ConfirmedQueries(tuple(queries), left_out)


def _part(most: int, parts: int) -> int:
    return max(most // parts, 1)
