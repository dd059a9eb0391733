"""The answers that this replica gave last, for those who watch."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from ..query_workers.answer import EncodedAnswer

MOST_ANSWERS = 500


@dataclass(frozen=True)
class RecentAnswer:
    """One answer.

    Attributes:
        number: of the answer in this process, ascending without gaps.
        time_s: when it was given, since the epoch.
        caller: name of who asked.
        seconds: from the query's arrival to its answer.
    """

    number: int
    time_s: float
    caller: str
    transport: str
    seconds: float
    answer: EncodedAnswer


class RecentAnswers:
    """The last ``MOST_ANSWERS`` answers. Thread-safe. Nothing here parses their JSON."""

    def __init__(self) -> None:
        self._numbers = itertools.count(1)
        self._kept: deque[RecentAnswer] = deque(maxlen=MOST_ANSWERS)
        self._lock = threading.Lock()

    def add(self, caller: str, transport: str, seconds: float, answer: EncodedAnswer) -> None:
        """Keeps an answer, and forgets the oldest if there are too many."""
        with self._lock:
            number = next(self._numbers)
            self._kept.append(RecentAnswer(number, time.time(), caller, transport, seconds, answer))

    def after(self, number: int) -> list[RecentAnswer]:
        """Returns the kept answers with higher numbers, oldest first."""
        with self._lock:
            newest_first: Iterator[RecentAnswer] = reversed(self._kept)
            return list(itertools.takewhile(lambda one: one.number > number, newest_first))[::-1]
