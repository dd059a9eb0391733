"""Tries over zenoh, with the service's clock: a robot's own may be wrong."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

from firstfix.errors import ClockSkew, Unauthorized
from firstfix.wire.signature import NONCE_BYTES, Asked, SigningKey

from ..errors import TRANSIENT, ServiceUnreachable, error_of_problem
from ..steps.step import Answer, Outcome, Try, lost, refused, too_late
from .blocking import Asked as Performed
from .blocking import race
from .live_replicas import LiveReplicas


class ServiceClock:
    """This machine's clock, until the service has shown that it is wrong. Thread-safe."""

    def __init__(self) -> None:
        self._ahead_s: float | None = None  # of the monotonic clock, which nobody sets

    @property
    def now_ms(self) -> int:
        """Milliseconds since 1970 (UTC)."""
        now_s = time.time() if self._ahead_s is None else time.monotonic() + self._ahead_s
        return max(0, int(now_s * 1000))

    def follow(self, time_ms: int) -> None:
        """Take over the service's time that has just arrived. It is never ahead: at most late by its way."""
        self._ahead_s = time_ms / 1000 - time.monotonic()


_UNSIGNED = (
    "this reply has no signature by the API key: the service does not know the key or asks for none, or "
    "somebody else answered"
)


# Errors of a service that could not check the query's signature, or not yet.
_MAY_BE_UNSIGNED: tuple[type[Exception], ...] = (Unauthorized, *TRANSIENT)


@dataclass(frozen=True)
class ZenohQuery:
    """Query to a replica.

    Attributes:
        encoding: media type of the payload.
        needs_credential: False: it is for anybody, and goes without signature and credential.
    """

    parameters: Mapping[str, str] = field(default_factory=dict)
    payload: bytes | None = None
    encoding: str | None = None
    needs_credential: bool = True


@dataclass(frozen=True)
class _Reply:
    is_ok: bool
    encoding: str
    content: bytes


class ZenohAsk:
    """Performs tries over zenoh. Thread-safe.

    Args:
        zenoh: the module.
        credential: an API key, which signs queries and checks replies; a token, which is sent as it is; or
            None.
    """

    def __init__(self, zenoh: Any, session: Any, credential: str | None, replicas: LiveReplicas) -> None:
        self._zenoh = zenoh
        self._session = session
        self._key = None if credential is None else SigningKey.of_api_key(credential)
        self._token = credential if self._key is None else None
        self._replicas = replicas
        self._clock = ServiceClock()

    @property
    def signs(self) -> bool:
        """True if queries are signed."""
        return self._key is not None

    def __call__(self, step: Try, opened: ExitStack) -> Performed:
        """Perform a try, as a race if it has a rival."""
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
        """A new cancellation token."""
        return self._zenoh.CancellationToken()

    def outcome_of(self, step: Try, target: str, until: float, token: Any) -> Outcome:
        """Ask one replica, or with the shared key any, and return the outcome."""
        query: ZenohQuery = step.make(_left_s(until))
        if self._key is None or not query.needs_credential:
            return self._first_outcome(query, target, until, token)
        outcome = self._signed_outcome(self._key, query, target, until, token)
        if not isinstance(outcome.failure, ClockSkew):
            return outcome
        self._clock.follow(outcome.failure.time_ms)
        return self._signed_outcome(self._key, query, target, until, token)

    def _first_outcome(self, query: ZenohQuery, target: str, until: float, token: Any) -> Outcome:
        """The outcome of the first reply, whoever gave it."""
        timeout_s = _left_s(until)
        attachment = self._token if query.needs_credential else None
        selector = self._zenoh.Selector(target, dict(query.parameters))
        for reply in self._get(selector, query, timeout_s, token, attachment=attachment):
            return _outcome(target, reply, timeout_s)
        return _no_answer(target)

    def _signed_outcome(
        self, key: SigningKey, query: ZenohQuery, target: str, until: float, token: Any
    ) -> Outcome:
        """The outcome of the first reply that the service has signed. Other replies are passed over."""
        timeout_s = _left_s(until)
        selector = self._zenoh.Selector(target, dict(query.parameters))
        encoding = None if query.encoding is None else self._zenoh.Encoding(query.encoding)
        asked = Asked.of(selector.key_expr, selector.parameters, encoding)
        signature = key.sign(asked, query.payload or b"", self._clock.now_ms, os.urandom(NONCE_BYTES))
        outcome = _no_answer(target)
        # All who declare the key get the query: otherwise zenoh might choose a stranger, not the replica.
        how = {"target": self._zenoh.QueryTarget.ALL, "attachment": signature.to_bytes()}
        for reply in self._get(selector, query, timeout_s, token, **how):
            if not key.has_replied(signature, reply.is_ok, reply.encoding, reply.content):
                outcome = _false(target, reply, timeout_s)
                continue
            self._replicas.prove(target)
            return _outcome(target, reply, timeout_s)
        return outcome

    def _get(
        self, selector: Any, query: ZenohQuery, timeout_s: float, token: Any, **how: Any
    ) -> Iterator[_Reply]:
        replies = self._session.get(
            selector,
            timeout=timeout_s,
            payload=query.payload,
            encoding=query.encoding,
            # By default zenoh holds replies back until all who were asked have ended, a router too. And it
            # might replace the true reply by a later one.
            consolidation=self._zenoh.ConsolidationMode.NONE,
            cancellation_token=token,
            **how,
        )
        for reply in replies:
            sample = reply.err if reply.ok is None else reply.ok
            yield _Reply(reply.ok is not None, str(sample.encoding), sample.payload.to_bytes())


class _Get:
    """One query with a deadline. It can be cancelled."""

    def __init__(self, ask: ZenohAsk, step: Try, target: str, until: float) -> None:
        self._ask, self._step, self._target, self._until = ask, step, target, until
        self._token = ask.token()

    def run(self) -> Outcome:
        return self._ask.outcome_of(self._step, self._target, self._until, self._token)

    def abort(self) -> None:
        self._token.cancel()


def _outcome(target: str, reply: _Reply, timeout_s: float) -> Outcome:
    if reply.is_ok:
        return Outcome(target, Answer(target, reply.content))
    problem = error_of_problem(reply.content)
    if problem is None:  # zenoh's own error: a timeout
        return too_late(target, timeout_s, repeatable=True)
    return refused(target, problem, repeatable=True)


def _false(target: str, reply: _Reply, timeout_s: float) -> Outcome:
    """The outcome if no better reply comes: a reply that may be anybody's decides nothing."""
    problem = None if reply.is_ok else error_of_problem(reply.content)
    if problem is None and not reply.is_ok:
        return too_late(target, timeout_s, repeatable=True)
    said = "" if problem is None else f"{problem}: "
    text = f"no answer from {target}: {said}{_UNSIGNED}"
    kind = next((kind for kind in _MAY_BE_UNSIGNED if isinstance(problem, kind)), ServiceUnreachable)
    return lost(target, kind(text), repeatable=True)


def _no_answer(target: str) -> Outcome:
    return lost(target, ServiceUnreachable(f"no replica answers on {target}"), repeatable=True)


def _left_s(until: float) -> float:
    return max(until - time.monotonic(), 0.001)
