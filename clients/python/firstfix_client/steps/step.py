"""Kinds of steps that a call consists of.

Every call of the clients is written once, as a generator. It yields a step, and the driver sends back the
step's result. Drivers (``drivers.blocking``, ``drivers.async_http``) use sockets, threads and event loops.
Steps do not.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")
Steps = Generator[Any, Any, T]


@dataclass(frozen=True)
class Try:
    """Asks a replica, and another one too if the first is slow. Its result is an ``Outcome``.

    Attributes:
        target: the replica's URL or key.
        make: makes the request, from the seconds that it may take.
        timeout_s: limit for the whole try.
        repeatable: the request may be sent again although a replica may have acted on it.
        stream: a successful answer is read line by line, with ``NextLine``.
        rival: second replica, and the seconds after which it is asked. The first answer wins, the other query
            is cancelled.
    """

    target: str
    make: Callable[[float], Any]
    timeout_s: float
    repeatable: bool = True
    stream: bool = False
    rival: tuple[str, float] | None = None


@dataclass(frozen=True)
class Sleep:
    """Waits."""

    seconds: float


@dataclass(frozen=True)
class Work:
    """Calls a function that uses the processor or the disk, not the network."""

    function: Callable[[], Any]


@dataclass(frozen=True)
class NextLine:
    """Reads the next line of the last stream; its result is None when the stream ended or broke."""


@dataclass(frozen=True)
class Emit:
    """Gives an item to the caller of a call that yields items."""

    item: Any


def work(function: Callable[[], T]) -> Steps[T]:
    """Returns the function's result, or raises its exception."""
    return (yield Work(function))


def advance(steps: Steps[T], reply: Any, error: Exception | None) -> Any:
    """Returns the next step.

    Raises:
        StopIteration: the call has ended; it carries the result.
    """
    return steps.send(reply) if error is None else steps.throw(error)
