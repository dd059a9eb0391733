"""Refusals of zenoh queries: beyond the rate of who asks they come late, as over HTTP."""

from __future__ import annotations

from asyncio import sleep
from collections import Counter

from firstfix.errors import Overloaded

from ..limits.byte_budget import Lease, owners_of_body
from ..limits.limits import Limits
from ..limits.turns import Turns
from ..telemetry.request_scope import note

UNAUTHENTICATED = "zenoh"  # all together: zenoh does not say from which connection a query came


class Refusals:
    """Refusals that wait for the turn of who asks. For use by one event loop.

    A caller who goes on asking without its answers is not held back by late ones. So further refusals come at
    once when many wait, or when there is no room for their bodies, which zenoh keeps until the reply.

    Args:
        turns: those of HTTP.
    """

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._waiting: Counter[str] = Counter()

    async def wait(self, caller: str, body: Lease) -> None:
        """Count a refusal, and waits until it is within the rate of who asks.

        Args:
            caller: empty: unauthenticated.
            body: of the query; it counts for who asks from now on.
        """
        name = caller or UNAUTHENTICATED
        wait_s = self._turns.rate_of(caller).take(name)
        if not wait_s or self._waiting[name] >= Limits.max_waiting_refusals:
            return
        if not body.owners:
            try:
                body.name(*owners_of_body(name))
            except Overloaded:
                return
        note(waited_ms=round(wait_s * 1e3))
        self._waiting[name] += 1
        try:
            await sleep(wait_s)
        finally:
            self._waiting[name] -= 1
            if not self._waiting[name]:
                del self._waiting[name]
