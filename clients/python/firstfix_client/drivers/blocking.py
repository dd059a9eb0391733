"""Driver for blocking calls: performs steps in the caller's thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from typing import Any, TypeVar

from ..steps.outcome import Outcome
from ..steps.step import Emit, NextLine, Sleep, Steps, Try, Work, advance

T = TypeVar("T")
Asked = tuple[Outcome, Iterator[str]]  # and the lines of a streamed answer
Ask = Callable[[Try, ExitStack], Asked]


def run(steps: Steps[T], ask: Ask) -> T:
    """Performs a call and returns its result.

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
    """Performs a call: yields its items, then returns its result."""
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
