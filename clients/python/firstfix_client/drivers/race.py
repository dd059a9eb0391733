"""A race of two attempts for blocking calls: the first answer wins."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace
from typing import Protocol

from ..steps.outcome import Outcome


class Attempt(Protocol):
    """One attempt; it runs in its own thread."""

    def run(self) -> Outcome:
        """Blocks until there is an outcome. Never raises."""
        ...

    def abort(self) -> None:
        """Ends ``run`` early, from another thread. Its outcome is ignored."""
        ...


def race(first: Attempt, second: Attempt, after_s: float, late: Outcome, timeout_s: float) -> Outcome:
    """Runs the first attempt, and after ``after_s`` the second one too. Returns the first outcome.

    If the first outcome is a failure that another replica may not have, the other attempt decides.

    Args:
        late: outcome if ``timeout_s`` is over.
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
    finally:  # no effect on an attempt that has ended
        for attempt in running:
            attempt.abort()
