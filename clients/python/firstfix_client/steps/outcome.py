"""What came of asking one replica once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from firstfix.errors import DeadlineExceeded, FirstfixError, RateLimited, ReadOnly

from ..errors import PASSING, ServiceUnreachable


@dataclass(frozen=True)
class Outcome:
    """
    Attributes:
        target: who was asked.
        answer: what it said; None: there is a failure.
        again: the same one may do better after a wait.
        elsewhere: another replica may do better at once.
        asked_wait_s: how long it wants to be left alone.
        took_s: until it came.
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
        return not (self.again or self.elsewhere)


def not_reached(target: str, why: object) -> Outcome:
    """Nobody was there, so nobody acted."""
    failure = ServiceUnreachable(f"no answer from {target}: {why}")
    return Outcome(target, failure=failure, again=True, elsewhere=True)


def lost(target: str, failure: Exception, *, repeatable: bool) -> Outcome:
    """Somebody may have acted, and did not live or wait to tell."""
    return Outcome(target, failure=failure, again=repeatable, elsewhere=repeatable)


def too_late(target: str, timeout_s: float, *, repeatable: bool) -> Outcome:
    return lost(target, DeadlineExceeded(f"no answer within {timeout_s:.3g} s"), repeatable=repeatable)


def refused(
    target: str, problem: FirstfixError, *, repeatable: bool, asked_wait_s: float | None = None
) -> Outcome:
    """A problem document: of a moment, of this replica, or final."""
    passing = isinstance(problem, PASSING)
    # A limit counts for a caller wherever it goes. One that was told too short a deadline, as replicas are
    # whose peers shall have some of the time, says so while there is time left.
    theirs = isinstance(problem, ReadOnly) or (repeatable and isinstance(problem, DeadlineExceeded))
    return Outcome(
        target,
        failure=problem,
        again=passing,
        elsewhere=theirs or (passing and not isinstance(problem, RateLimited)),
        asked_wait_s=asked_wait_s,
    )
