"""Retries, failover and hedging of one request within its deadline."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from firstfix.errors import DeadlineExceeded

from ..policies import HedgePolicy, RetryPolicy
from .step import Outcome, Sleep, Steps, Try


class Deadline:
    """A point in time that all tries and waits of one call share."""

    def __init__(self, timeout_s: float) -> None:
        self._end_s = time.monotonic() + timeout_s
        self._timeout_s = timeout_s

    def remaining_s(self) -> float:
        """The seconds that are left.

        Raises:
            DeadlineExceeded: no time is left.
        """
        left = self._end_s - time.monotonic()
        if left <= 0:
            raise self.exceeded()
        return left

    def allows(self, wait_s: float) -> bool:
        """Whether time is left after such a wait."""
        return time.monotonic() + wait_s < self._end_s

    def exceeded(self) -> DeadlineExceeded:
        """The error that says so."""
        return DeadlineExceeded(f"no answer within {self._timeout_s:g} s")


REMEMBERED = 200
ENOUGH = 20


class Hedging:
    """A hedge policy with the response times seen so far. Thread-safe."""

    def __init__(self, policy: HedgePolicy) -> None:
        self._policy = policy
        self._took_s: deque[float] = deque(maxlen=REMEMBERED)
        self._lock = threading.Lock()

    def saw(self, took_s: float) -> None:
        """Record how long an answer took."""
        with self._lock:
            self._took_s.append(took_s)

    def after_s(self) -> float:
        """The seconds after which the second replica is asked."""
        if self._policy.after_s is not None:
            return self._policy.after_s
        with self._lock:
            took_s = sorted(self._took_s)
        seen = took_s[len(took_s) * 95 // 100] if len(took_s) >= ENOUGH else self._policy.first_after_s
        return max(seen, self._policy.min_after_s)


class Route(Protocol):
    """Known replicas, and the order in which they are asked. Thread-safe."""

    def order(self) -> list[str]:
        """The replicas in the order in which to ask them; never empty."""
        ...

    def rival(self, target: str, others: list[str]) -> str | None:
        """A second replica to ask, one of ``others`` or the target itself; None: no one."""
        ...

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """Whom to ask at half of the time if there is no rival: a message may be lost."""
        ...

    def answered(self, target: str) -> None:
        """Record that the target has answered."""
        ...


def send(
    make: Callable[[float], Any],
    route: Route,
    retry: RetryPolicy,
    deadline: Deadline,
    *,
    repeatable: bool = True,
    stream: bool = False,
    hedging: Hedging | None = None,
) -> Steps[Any]:
    """Send a request until a replica answers.

    Replicas are asked one after the other without a wait. A wait comes before each new round.

    Args:
        make: makes the request for one try, from the seconds that the try may take.
        repeatable: the request may be sent again although a replica may have acted on it.
        stream: the answer is read line by line.
        hedging: when a second replica is asked; None: never.

    Raises:
        FirstfixError: the error in a replica's problem document.
        DeadlineExceeded: the deadline passed.
        ServiceUnreachable: the last try reached no replica.
    """
    patience = Deadline(retry.patience_s)
    attempt = rounds = 0
    tried: set[str] = set()
    asked_wait_s: float | None = None
    while True:
        left_s = deadline.remaining_s()
        fresh = [target for target in route.order() if target not in tried]
        if not fresh:  # replicas came and went meanwhile
            tried.clear()
            continue
        target, *others = fresh
        rival = None
        if hedging is not None:
            if (other := route.rival(target, others)) is not None:
                rival = other, hedging.after_s()
            elif (other := route.last_resort(target, others)) is not None:
                rival = other, left_s / 2
        # a replica that hangs must leave time for another one
        spare = len(others) > (0 if rival is None else 1)
        timeout_s = left_s / 2 if spare and repeatable else left_s
        attempt += 1
        outcome: Outcome = yield Try(target, make, timeout_s, repeatable, stream, rival)
        if outcome.failure is None:
            route.answered(outcome.target)
            if hedging is not None:
                hedging.saw(outcome.took_s)
            return outcome.answer
        tried.add(target)
        if outcome.raced and rival is not None:
            tried.add(rival[0])
        left = [one for one in others if one not in tried]
        if outcome.asked_wait_s is not None:
            asked_wait_s = max(outcome.asked_wait_s, asked_wait_s or 0.0)
        spent = retry.attempts is not None and attempt >= retry.attempts
        if outcome.elsewhere and left and not spent:
            continue
        rounds += 1
        wait_s = retry.wait_s(rounds, asked_wait_s)
        if not outcome.again or spent or not deadline.allows(wait_s) or not patience.allows(wait_s):
            raise outcome.failure
        yield Sleep(wait_s)
        tried.clear()
        asked_wait_s = None
