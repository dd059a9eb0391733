"""One request to whichever replica answers it: retries, failover and hedging within one deadline."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from .hedge import Hedging
from .outcome import Outcome
from .retry import Deadline, RetryPolicy
from .step import Sleep, Steps, Try


class Route(Protocol):
    """The replicas that there are. Thread-safe."""

    def order(self) -> list[str]:
        """Whom to ask, one after the other; never empty."""
        ...

    def rival(self, target: str, others: list[str]) -> str | None:
        """Whom to ask beside the target, of those that were not asked yet or the target itself."""
        ...

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """Whom to ask without a rival, when half of the time has passed: a message may have got lost."""
        ...

    def answered(self, target: str) -> None:
        """It works."""
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
    """The first answer that any replica gives.

    Replicas are asked one after the other without a wait; when none is left, they are given time and asked
    again.

    Args:
        make: the request of one try, from the seconds that it may take.
        repeatable: it may be sent again although a replica may have acted on it.
        stream: the answer's lines are wanted one by one.
        hedging: when a second one is asked; None: never.

    Raises:
        FirstfixError: what a replica's problem document stands for.
        DeadlineExceeded: the deadline passed.
        ServiceUnreachable: the last try reached nobody.
    """
    patience = Deadline(retry.patience_s)
    attempt = rounds = 0
    tried: set[str] = set()
    asked_wait_s: float | None = None
    while True:
        left_s = deadline.remaining_s()
        fresh = [target for target in route.order() if target not in tried]
        if not fresh:  # those that came and went meanwhile
            tried.clear()
            continue
        target, *others = fresh
        rival = None
        if hedging is not None:
            if (other := route.rival(target, others)) is not None:
                rival = other, hedging.after_s()
            elif (other := route.last_resort(target, others)) is not None:
                rival = other, left_s / 2
        # those that hang must leave time for another
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
