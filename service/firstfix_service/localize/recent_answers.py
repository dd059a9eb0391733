"""The answers of the last time, for those who watch."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import orjson

from ..query_workers.query import EncodedAnswer

MAX_ANSWERS = 500


@dataclass(frozen=True)
class RecentAnswer:
    """One answer.

    Attributes:
        number: of the answer in this process, ascending without gaps, whoever gave it.
        replica: name of the one that gave it.
        time_s: when it was given, since the epoch.
        caller: name of who asked.
        robot: name of the robot as the caller gave it, else of its key; empty if there is none.
        seconds: from the query's arrival to its answer.
        map_id: the map of the answer; empty if there is none.
        json: the answer; of another replica only its main fields.
    """

    number: int
    replica: str
    time_s: float
    caller: str
    robot: str
    transport: str
    seconds: float
    map_id: str
    json: bytes

    @cached_property
    def event(self) -> bytes:
        """The answer as a server-sent event: made once for all who watch, and only if somebody does."""
        head = orjson.dumps(
            {
                "number": self.number,
                "replica": self.replica,
                "time_s": self.time_s,
                "caller": self.caller,
                "robot": self.robot,
                "transport": self.transport,
                "ms": self.seconds * 1e3,
            }
        )
        return b'event: answer\nid: %d\ndata: %s,"answer":%s}\n\n' % (self.number, head[:-1], self.json)


class RecentAnswers:
    """The last ``MAX_ANSWERS`` answers of this replica, and as many of all others. Thread-safe.

    Others can never displace this replica's own. Nothing here parses JSON.

    Args:
        make_late: adds the answers of this replica that still wait for it (``LateCounts``).

    Attributes:
        replica: name of this replica.
        hears_others: set where other replicas tell of their answers.
    """

    def __init__(self, replica: str = "", make_late: Callable[[], None] = lambda: None) -> None:
        self.replica = replica
        self.hears_others = False
        self._numbers = itertools.count(1)
        self._own: deque[RecentAnswer] = deque(maxlen=MAX_ANSWERS)
        self._heard: deque[RecentAnswer] = deque(maxlen=MAX_ANSWERS)
        self._watchers = 0
        self._make_late = make_late
        self._lock = threading.Lock()

    def add(
        self,
        caller: str,
        transport: str,
        seconds: float,
        answer: EncodedAnswer,
        robot: str = "",
        *,
        time_s: float,
    ) -> None:
        """Keep an answer of this replica, and forget the oldest if there are too many."""
        map_id, json = answer.map_id, answer.json
        with self._lock:
            number = next(self._numbers)
            self._own.append(
                RecentAnswer(number, self.replica, time_s, caller, robot, transport, seconds, map_id, json)
            )

    def hear(
        self,
        replica: str,
        *,
        time_s: float,
        caller: str,
        robot: str,
        transport: str,
        seconds: float,
        map_id: str,
        json: bytes,
    ) -> None:
        """Keep an answer of another replica, and forget the oldest of others if there are too many."""
        with self._lock:
            number = next(self._numbers)
            self._heard.append(
                RecentAnswer(number, replica, time_s, caller, robot, transport, seconds, map_id, json)
            )

    def after(self, number: int) -> list[RecentAnswer]:
        """The kept answers of all replicas with higher numbers, in the order of their numbers."""
        self._make_late()
        with self._lock:
            found = _newer(self._own, number) + _newer(self._heard, number)
        return sorted(found, key=lambda one: one.number)

    def own_after(self, number: int) -> list[RecentAnswer]:
        """The kept answers of this replica with higher numbers, oldest first."""
        self._make_late()
        with self._lock:
            return _newer(self._own, number)

    @property
    def watchers(self) -> int:
        """The number of watchers."""
        with self._lock:
            return self._watchers

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Count a watcher while it lasts: other replicas are heard only for watchers."""
        with self._lock:
            self._watchers += 1
        try:
            yield
        finally:
            with self._lock:
                self._watchers -= 1


def _newer(kept: deque[RecentAnswer], number: int) -> list[RecentAnswer]:
    return list(itertools.takewhile(lambda one: one.number > number, reversed(kept)))[::-1]
