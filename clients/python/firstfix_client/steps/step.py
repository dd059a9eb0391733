"""Kinds of steps that a call consists of, and the outcome of a try.

Every call of the clients is written once, as a generator. It yields a step, and the driver sends back the
step's result. Drivers (``drivers.blocking``, ``drivers.async_http``) use sockets, threads and event loops.
Steps do not: the design is known as *sans-I/O*.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeVar

from firstfix.errors import DeadlineExceeded, FirstfixError, RateLimited, ReadOnly

from ..errors import TRANSIENT, ServiceUnreachable

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
    """The function's result, or raises its exception."""
    return (yield Work(function))


def advance(steps: Steps[T], reply: Any, error: Exception | None) -> Any:
    """The next step.

    Raises:
        StopIteration: the call has ended; it carries the result.
    """
    return steps.send(reply) if error is None else steps.throw(error)


@dataclass(frozen=True)
class Answer:
    """Successful answer to a request.

    Attributes:
        source: the URL or key that was asked.
        body: empty for an answer that is read line by line.
    """

    source: str
    body: bytes

    def parsed(self, parse: Callable[[Any], T]) -> T:
        """The answer's JSON, read by ``parse``.

        Raises:
            FirstfixError: it does not follow the protocol: another service, or a proxy's page.
        """
        try:
            return parse(json.loads(self.body))
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            raise FirstfixError(
                f"{self.source} sent an answer that this client cannot read: {error!r}"
            ) from None


@dataclass(frozen=True)
class Outcome:
    """Outcome of one try: an answer or a failure.

    Attributes:
        target: the replica that was asked.
        answer: its answer; None: see ``failure``.
        again: worth another try on the same replica, after a wait.
        elsewhere: worth a try on another replica, at once.
        asked_wait_s: wait that the replica asked for.
        took_s: time until the answer.
        raced: the rival was asked too.
    """

    target: str
    answer: Any = None
    failure: Exception | None = None
    again: bool = False
    elsewhere: bool = False
    asked_wait_s: float | None = None
    took_s: float = 0.0
    raced: bool = False

    @property
    def is_final(self) -> bool:
        """True if another try is of no use."""
        return not (self.again or self.elsewhere)


def not_reached(target: str, why: object) -> Outcome:
    """The outcome when no replica got the request."""
    failure = ServiceUnreachable(f"no answer from {target}: {why}")
    return Outcome(target, failure=failure, again=True, elsewhere=True)


def lost(target: str, failure: Exception, *, repeatable: bool) -> Outcome:
    """The outcome when a replica may have acted but its answer was lost."""
    return Outcome(target, failure=failure, again=repeatable, elsewhere=repeatable)


def too_late(target: str, timeout_s: float, *, repeatable: bool) -> Outcome:
    """The outcome when the time of the try is over."""
    return lost(target, DeadlineExceeded(f"no answer within {timeout_s:.3g} s"), repeatable=repeatable)


def refused(
    target: str, problem: FirstfixError, *, repeatable: bool, asked_wait_s: float | None = None
) -> Outcome:
    """The outcome for a problem document."""
    transient = isinstance(problem, TRANSIENT)
    # A rate limit holds on every replica. A try gets only a part of the time if other replicas remain, so a
    # replica may report that its deadline is over while the call has time left.
    of_this_replica = isinstance(problem, ReadOnly) or (repeatable and isinstance(problem, DeadlineExceeded))
    return Outcome(
        target,
        failure=problem,
        again=transient,
        elsewhere=of_this_replica or (transient and not isinstance(problem, RateLimited)),
        asked_wait_s=asked_wait_s,
    )
