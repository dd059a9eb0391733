"""The turn of a request over HTTP: whoever asks too fast waits, before any work is done for the request."""

from __future__ import annotations

from starlette.requests import ClientDisconnect
from starlette.types import Scope

from ..http_server.streams import DELAY_ANSWER, DelayAnswer
from ..limits.rate import Rate
from ..limits.turns import Turns
from ..telemetry.request_scope import note

PROBES = frozenset({"/healthz", "/readyz"})


class Turn:
    """The turn of one request, which counts once."""

    def __init__(self, turns: Turns, scope: Scope) -> None:
        self._turns = turns
        self._scope = scope
        self._was_counted = False

    async def wait_to_begin(self, caller: str = "") -> bool:
        """Wait before the work for a request until it is within the rate of who asks.

        Args:
            caller: empty: unauthenticated.

        Returns:
            whether it had to wait.

        Raises:
            ClientDisconnect: the caller has gone meanwhile. The request does not count then.
        """
        wait_s = self._take(caller)
        if wait_s and not await self._delay(wait_s):
            self._rate_of(caller).give_back(self._name(caller))
            raise ClientDisconnect
        return wait_s > 0.0

    async def wait_to_answer(self, caller: str) -> None:
        """Wait before the answer to a request that did not wait before its work: nobody knew who asks.

        Args:
            caller: empty: unauthenticated.
        """
        wait_s = self._take(caller)
        if wait_s:
            await self._delay(wait_s)

    def _take(self, caller: str) -> float:
        """Count the request, and return how long it has to wait, seconds."""
        if self._was_counted or DELAY_ANSWER not in self._scope.get("extensions", {}):
            return 0.0
        self._was_counted = True
        return self._rate_of(caller).take(self._name(caller))

    async def _delay(self, wait_s: float) -> bool:
        note(waited_ms=round(wait_s * 1e3))
        delay: DelayAnswer = self._scope["extensions"][DELAY_ANSWER]
        return await delay(wait_s)

    def _rate_of(self, caller: str) -> Rate:
        return self._turns.rate_of(caller, is_probe=self._scope["path"] in PROBES)

    def _name(self, caller: str) -> str:
        return caller or str(self._scope["state"]["address"])


def turn_of(scope: Scope) -> Turn:
    """The turn of a request."""
    state = scope["state"]
    turn: Turn | None = state.get("turn")
    if turn is None:
        turn = state["turn"] = Turn(state["turns"], scope)
    return turn
