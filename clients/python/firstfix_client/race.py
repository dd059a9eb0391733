"""Two attempts of which the first answer counts, for callers that block."""

from __future__ import annotations

import queue
import threading
from dataclasses import replace
from typing import Protocol

from .outcome import Outcome


class Attempt(Protocol):
    def run(self) -> Outcome:
        """Blocks until there is an outcome; raises nothing."""
        ...

    def abort(self) -> None:
        """Ends ``run`` early, from another thread. Its outcome does not matter any more."""
        ...


def race(first: Attempt, second: Attempt, after_s: float) -> Outcome:
    """The outcome of the first attempt, or of the second, which starts if the first takes ``after_s``.

    A failure that another replica may not have waits for the other attempt's outcome.
    """
    outcomes: queue.SimpleQueue[Outcome | BaseException] = queue.SimpleQueue()
    running: list[Attempt] = []

    def start(attempt: Attempt) -> None:
        def run() -> None:
            try:
                outcomes.put(attempt.run())
            except BaseException as defect:
                outcomes.put(defect)

        running.append(attempt)
        threading.Thread(target=run, name="firstfix query", daemon=True).start()

    try:
        start(first)
        try:
            outcome, raced = outcomes.get(timeout=after_s), False
        except queue.Empty:
            raced = True
            start(second)
            outcome = outcomes.get()
            if isinstance(outcome, Outcome) and not outcome.is_final:
                outcome = outcomes.get()
        if isinstance(outcome, BaseException):
            raise outcome
        return replace(outcome, raced=raced)
    finally:  # those that are done do not mind
        for attempt in running:
            attempt.abort()
