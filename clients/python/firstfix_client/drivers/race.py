"""Two attempts of which the first answer counts, for callers that block."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace
from typing import Protocol

from ..steps.outcome import Outcome


class Attempt(Protocol):
    def run(self) -> Outcome:
        """Blocks until there is an outcome; raises nothing."""
        ...

    def abort(self) -> None:
        """Ends ``run`` early, from another thread. Its outcome does not matter any more."""
        ...


def race(first: Attempt, second: Attempt, after_s: float, late: Outcome, timeout_s: float) -> Outcome:
    """The outcome of the first attempt, or of the second, which starts if the first takes ``after_s``.

    A failure that another replica may not have waits for the other attempt's outcome.

    Args:
        late: the outcome when ``timeout_s`` are over.
    """
    until = time.monotonic() + timeout_s
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

    def outcome_within(seconds: float) -> Outcome | None:
        try:
            found = outcomes.get(timeout=max(seconds, 0))
        except queue.Empty:
            return None
        if isinstance(found, BaseException):
            raise found
        return found

    try:
        start(first)
        outcome = outcome_within(min(after_s, timeout_s))
        if outcome is not None:
            return outcome
        start(second)
        outcome = outcome_within(until - time.monotonic())
        if outcome is not None and not outcome.is_final:
            outcome = outcome_within(until - time.monotonic())
        return replace(outcome or late, raced=True)
    finally:  # those that are done do not mind
        for attempt in running:
            attempt.abort()
