"""Tries over zenoh."""

from __future__ import annotations

import random
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import ServiceUnreachable, error_of_problem
from ..steps.answer import Answer
from ..steps.outcome import Outcome, lost, refused, too_late
from ..steps.step import Try
from .blocking import Asked
from .live_replicas import LiveReplicas
from .race import race


@dataclass(frozen=True)
class ZenohQuery:
    """Query to a replica.

    Attributes:
        encoding: media type of the payload.
    """

    parameters: Mapping[str, str] = field(default_factory=dict)
    payload: bytes | None = None
    encoding: str | None = None


class ReplicaRoute:
    """Route to the live replicas of a key in random order, with their shared key last."""

    def __init__(self, shared: str, replicas: LiveReplicas | None) -> None:
        self._shared = shared
        self._replicas = replicas

    def order(self) -> list[str]:
        """Returns the replicas' keys in random order, then the shared key."""
        live = [] if self._replicas is None else self._replicas.of(self._shared)
        random.shuffle(live)
        return [*live, self._shared]

    def rival(self, target: str, others: list[str]) -> str | None:
        """Returns another live replica, never the shared key: the same replica might get the query."""
        return others[0] if len(others) > 1 else None

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """Returns the shared key: zenoh may not report a query lost when the only replica restarts."""
        return self._shared

    def answered(self, target: str) -> None:
        """Does nothing: the next query goes to another replica, so the load is spread."""


class ZenohAsk:
    """Performs tries over zenoh. Thread-safe.

    Args:
        zenoh: the module.
    """

    def __init__(self, zenoh: Any, session: Any, api_key: str | None) -> None:
        self._zenoh = zenoh
        self._session = session
        self._api_key = api_key

    def __call__(self, step: Try, opened: ExitStack) -> Asked:
        """Performs a try, as a race if it has a rival."""
        begun = time.monotonic()
        until = begun + step.timeout_s
        first = _Get(self, step, step.target, until)
        if step.rival is None:
            outcome = first.run()
        else:
            target, after_s = step.rival
            late = too_late(step.target, step.timeout_s, repeatable=True)
            outcome = race(first, _Get(self, step, target, until), after_s, late, step.timeout_s)
        return replace(outcome, took_s=time.monotonic() - begun), iter(())

    def token(self) -> Any:
        """Returns a new cancellation token."""
        return self._zenoh.CancellationToken()

    def first_outcome(self, step: Try, target: str, timeout_s: float, token: Any) -> Outcome:
        """Asks one replica and returns the outcome of its first reply."""
        query: ZenohQuery = step.make(timeout_s)
        selector = self._zenoh.Selector(target, dict(query.parameters))
        replies = self._session.get(
            selector,
            timeout=timeout_s,
            payload=query.payload,
            encoding=query.encoding,
            attachment=self._api_key,
            # By default zenoh holds replies back until all who were asked have ended. A router is asked too.
            consolidation=self._zenoh.ConsolidationMode.NONE,
            cancellation_token=token,
        )
        for reply in replies:
            if reply.ok is not None:
                return Outcome(target, Answer(target, reply.ok.payload.to_bytes()))
            problem = error_of_problem(reply.err.payload.to_bytes())
            if problem is None:  # zenoh's own error: a timeout
                return too_late(target, timeout_s, repeatable=True)
            return refused(target, problem, repeatable=True)
        return lost(target, ServiceUnreachable(f"no replica answers on {target}"), repeatable=True)


class _Get:
    """One query with a deadline. It can be cancelled."""

    def __init__(self, ask: ZenohAsk, step: Try, target: str, until: float) -> None:
        self._ask, self._step, self._target, self._until = ask, step, target, until
        self._token = ask.token()

    def run(self) -> Outcome:
        left_s = max(self._until - time.monotonic(), 0.001)
        return self._ask.first_outcome(self._step, self._target, left_s, self._token)

    def abort(self) -> None:
        self._token.cancel()
