"""Driver for blocking calls: performs steps in the caller's thread, or two attempts as a race."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Protocol, TypeVar

from ..steps.step import Emit, NextLine, Outcome, Sleep, Steps, Try, Work, advance

T = TypeVar("T")
Asked = tuple[Outcome, Iterator[str]]  # and the lines of a streamed answer
Ask = Callable[[Try, ExitStack], Asked]


def run(steps: Steps[T], ask: Ask) -> T:
    """Perform a call and return its result.

    Args:
        ask: performs a Try. It registers open resources with the stack.
    """
    items = iterate(steps, ask)
    while True:
        try:
            next(items)
        except StopIteration as end:
            return end.value


def iterate(steps: Steps[T], ask: Ask) -> Generator[Any, None, T]:
    """Perform a call: yields its items, then return its result."""
    reply: Any = None
    error: Exception | None = None
    lines: Iterator[str] = iter(())
    with ExitStack() as opened:
        while True:
            try:
                step = advance(steps, reply, error)
            except StopIteration as end:
                return end.value
            reply = error = None
            if isinstance(step, Emit):
                yield step.item
            elif isinstance(step, Try):
                opened.close()
                reply, lines = ask(step, opened)
            elif isinstance(step, NextLine):
                reply = next(lines, None)
            elif isinstance(step, Sleep):
                time.sleep(step.seconds)
            else:
                assert isinstance(step, Work)
                try:
                    reply = step.function()
                except Exception as raised:
                    error = raised


class Attempt(Protocol):
    """One attempt; it runs in its own thread."""

    def run(self) -> Outcome:
        """Block until there is an outcome. Never raises."""
        ...

    def abort(self) -> None:
        """Ends ``run`` early, from another thread. Its outcome is ignored."""
        ...


def race(first: Attempt, second: Attempt, after_s: float, late: Outcome, timeout_s: float) -> Outcome:
    """Run the first attempt, and after ``after_s`` the second one too. Returns the first outcome.

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
