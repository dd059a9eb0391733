"""Refusals of zenoh queries: beyond the credit of who asks they come late, as over HTTP."""

from __future__ import annotations

from asyncio import sleep
from collections import Counter

from firstfix.errors import Overloaded

from ..auth.turns import Turns
from ..localize.held_bodies import HeldBody
from ..telemetry.request_scope import note

STRANGERS = "zenoh"  # all together: zenoh does not say from which connection a query came
MOST_WAITING = 250  # of a caller: as many wait as keep to the rate, and as many connections wait over HTTP


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

    async def wait(self, caller: str, body: HeldBody) -> None:
        """Counts a refusal, and waits until it is within the credit of who asks.

        Args:
            caller: empty: a stranger.
            body: of the query; it counts for who asks from now on.
        """
        name = caller or STRANGERS
        wait_s = self._turns.credit_of(caller).take(name)
        if not wait_s or self._waiting[name] >= MOST_WAITING:
            return
        if not body.caller:
            try:
                body.name_caller(name)
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
