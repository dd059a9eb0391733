"""Outcomes of the calls of the drill, and figures from them."""

from __future__ import annotations

import itertools
import statistics
import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Call:
    """One call.

    Attributes:
        due: when it was to begin, of ``time.monotonic``. Callers do not wait for each other.
        seconds: from then to its end.
        code: "ok", or the code of the error.
    """

    kind: str
    due: float
    seconds: float
    code: str


class Outcomes:
    """All calls that ended, and those that have not. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._ended: list[Call] = []
        self._open: dict[int, tuple[str, float]] = {}

    def begin(self, number: int, kind: str, due: float) -> None:
        with self._lock:
            self._open[number] = kind, due

    def end(self, number: int, code: str) -> None:
        now = time.monotonic()
        with self._lock:
            kind, due = self._open.pop(number)
            self._ended.append(Call(kind, due, now - due, code))

    def open_of(self, kind: str) -> int:
        with self._lock:
            return sum(1 for one, _ in self._open.values() if one == kind)

    def has_open(self, end: float) -> bool:
        """True while a call that was due before then has not ended."""
        with self._lock:
            return any(due < end for _, due in self._open.values())

    def between(self, begin: float, end: float) -> list[Call]:
        """Call that were due then; one without an end counts as ``unanswered``."""
        now = time.monotonic()
        with self._lock:
            unanswered = [Call(kind, due, now - due, "unanswered") for kind, due in self._open.values()]
            return [call for call in (*self._ended, *unanswered) if begin <= call.due < end]

    def first_good(self, kind: str, begin: float) -> float | None:
        """The end of the first good call that was due from then on; None: there is none yet."""
        with self._lock:
            good = [
                one.due + one.seconds
                for one in self._ended
                if one.kind == kind and one.due >= begin and one.code == "ok"
            ]
        return min(good, default=None)


@dataclass(frozen=True)
class Latency:
    """Seconds of one kind of call over some time.

    Attributes:
        p99_s: median of the p99 of several windows: one hiccup of a busy machine does not count.
    """

    calls: int
    p50_s: float
    p99_s: float
    worst_s: float


def latency(calls: Sequence[Call], begin: float, end: float, window_s: float) -> Latency | None:
    """Latency of calls of one kind; None without any."""
    if not calls:
        return None
    count = max(1, round((end - begin) / window_s))
    edges = np.linspace(begin, end, count + 1)
    windows = [
        [call.seconds for call in calls if low <= call.due < high] for low, high in itertools.pairwise(edges)
    ]
    p99s = [float(np.percentile(window, 99)) for window in windows if window]
    seconds = [call.seconds for call in calls]
    return Latency(len(calls), statistics.median(seconds), statistics.median(p99s), max(seconds))


def errors(calls: Iterable[Call]) -> Counter[str]:
    """Call that failed, by kind and code."""
    return Counter(f"{call.kind}: {call.code}" for call in calls if call.code != "ok")
