"""What a call does, without doing it: steps that a blocking or an asynchronous driver performs.

Every call of the clients is written once, as a generator that yields what is to be done and is sent what
came of it. The drivers (``blocking``, ``async_http``) know sockets, threads and event loops; steps do not.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")
Steps = Generator[Any, Any, T]


@dataclass(frozen=True)
class Try:
    """Ask a replica, and another one too when the first takes long. The driver sends back an ``Outcome``.

    Attributes:
        target: the replica's address or key.
        make: the request, from the seconds that it may take.
        timeout_s: of the try as a whole.
        repeatable: the replica may be asked again although it may have acted.
        stream: a successful answer's lines are wanted one by one, by ``NextLine``.
        rival: whom to ask too, and after how many seconds. The first answer wins, the other is cancelled.
    """

    target: str
    make: Callable[[float], Any]
    timeout_s: float
    repeatable: bool = True
    stream: bool = False
    rival: tuple[str, float] | None = None


@dataclass(frozen=True)
class Sleep:
    seconds: float


@dataclass(frozen=True)
class Work:
    """Something that takes the processor or the disk, not the network."""

    function: Callable[[], Any]


@dataclass(frozen=True)
class NextLine:
    """The next line of the stream that was opened last; None: it ended or broke."""


@dataclass(frozen=True)
class Emit:
    """An item for the caller of a call that gives many."""

    item: Any


def work(function: Callable[[], T]) -> Steps[T]:
    """The function's result; what it raises is raised here."""
    return (yield Work(function))


def advance(steps: Steps[T], reply: Any, error: Exception | None) -> Any:
    """The next thing to do.

    Raises:
        StopIteration: with the call's result.
    """
    return steps.send(reply) if error is None else steps.throw(error)
