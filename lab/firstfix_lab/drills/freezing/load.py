"""Mixed load at a fixed pace: calls begin when they are due, whatever became of those before."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from .outcomes import Outcomes


@dataclass(frozen=True)
class Kind:
    """One kind of call.

    Attributes:
        call: makes it; returns "ok" or the code of the error, and raises nothing.
        most_open: calls at the same time; no further one begins before one of them has ended.
    """

    name: str
    per_s: float
    call: Callable[[], str]
    most_open: int = 40


class Load:
    """Callers of all kinds, until the end of a block."""

    def __init__(self, kinds: Sequence[Kind], outcomes: Outcomes) -> None:
        self.kinds = {kind.name: kind for kind in kinds}
        self._outcomes = outcomes
        self._numbers = itertools.count()
        self._stop = threading.Event()
        self._callers = {kind.name: ThreadPoolExecutor(kind.most_open, kind.name) for kind in kinds}
        self._pacers = [threading.Thread(target=self._pace, args=(kind,), daemon=True) for kind in kinds]

    def __enter__(self) -> Load:
        for pacer in self._pacers:
            pacer.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        for pacer in self._pacers:
            pacer.join()
        for callers in self._callers.values():
            callers.shutdown(cancel_futures=True)

    def _pace(self, kind: Kind) -> None:
        due = time.monotonic()
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            if self._outcomes.open_of(kind.name) < kind.most_open:
                number = next(self._numbers)
                self._outcomes.begin(number, kind.name, due)
                self._callers[kind.name].submit(self._call, kind, number)
            due = max(due + 1.0 / kind.per_s, time.monotonic() - 1.0)

    def _call(self, kind: Kind, number: int) -> None:
        self._outcomes.end(number, kind.call())
