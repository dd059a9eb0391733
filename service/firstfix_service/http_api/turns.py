"""Turns of requests: whoever asks too fast waits, before any work is done for the request."""

from __future__ import annotations

import time
from collections.abc import Callable

from fastapi import Request
from starlette.requests import ClientDisconnect
from starlette.types import Scope

from ..auth.rate_limit import RateLimit
from ..http_server.streams import DELAY_ANSWER, DelayAnswer
from ..telemetry.request_scope import note

REQUESTS_PER_S = 50.0  # of one caller or one address: they then take a few percent of a core
BURST_S = 2.0  # a page, its files and what it shows come at once, for several people behind one address
MAX_WAIT_S = 5.0  # of a caller: as many connections as one address may have keep to the rate
MAX_STRANGER_WAIT_S = 2.0  # people who open the console may share their address with a stranger
MAX_PROBE_WAIT_S = 0.5  # probes give up after a second, and one may share its address with a stranger
PROBES = frozenset({"/healthz", "/readyz"})


class Turns:
    """Turns of all who ask, for requests that no queue holds. For use by one event loop.

    Lists, files and refusals take about the same short time of the event loop that all share, so a refusal of
    those beyond a rate would save nothing: the next request would come at once. A request over its credit
    waits instead, and nothing fails. Callers are counted by name. Strangers, who have no caller, are counted
    by address: they ask for public files or for health, or their credential is missing or invalid.

    Args:
        clock: monotonic time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._callers, self._strangers, self._probes = (
            RateLimit(what, REQUESTS_PER_S, BURST_S * REQUESTS_PER_S, clock)
            for what in ("requests", "requests of strangers", "probes")
        )

    def credit_of(self, path: str, caller: str) -> tuple[RateLimit, float]:
        """Returns where a request counts, and how long it may have to wait, seconds.

        Args:
            caller: empty: a stranger.
        """
        if caller:
            return self._callers, MAX_WAIT_S
        if path in PROBES:
            return self._probes, MAX_PROBE_WAIT_S
        return self._strangers, MAX_STRANGER_WAIT_S


class Turn:
    """The turn of one request, which counts once."""

    def __init__(self, turns: Turns, scope: Scope) -> None:
        self._turns = turns
        self._scope = scope
        self._was_counted = False

    async def wait_to_begin(self, caller: str = "") -> bool:
        """Waits before the work for a request until it is within the credit of who asks.

        Args:
            caller: empty: a stranger.

        Returns:
            whether it had to wait.

        Raises:
            ClientDisconnect: the caller has gone meanwhile. The request does not count then.
        """
        wait_s = self._take(caller)
        if wait_s and not await self._delay(wait_s):
            credit, _ = self._turns.credit_of(self._scope["path"], caller)
            credit.give_back(self._name(caller))
            raise ClientDisconnect
        return wait_s > 0.0

    async def wait_to_answer(self, caller: str) -> None:
        """Waits before the answer to a request that did not wait before its work: nobody knew who asks.

        Args:
            caller: empty: a stranger.
        """
        wait_s = self._take(caller)
        if wait_s:
            await self._delay(wait_s)

    def _take(self, caller: str) -> float:
        """Counts the request, and returns how long it has to wait, seconds."""
        if self._was_counted or DELAY_ANSWER not in self._scope.get("extensions", {}):
            return 0.0
        self._was_counted = True
        credit, at_most_s = self._turns.credit_of(self._scope["path"], caller)
        return credit.take_on_credit(self._name(caller), at_most_s)

    async def _delay(self, wait_s: float) -> bool:
        note(waited_ms=round(wait_s * 1e3))
        delay: DelayAnswer = self._scope["extensions"][DELAY_ANSWER]
        return await delay(wait_s)

    def _name(self, caller: str) -> str:
        return caller or str(self._scope["state"]["address"])


def turn_of(request: Request) -> Turn:
    """Returns the turn of a request."""
    turn: Turn = request.state.turn
    return turn
