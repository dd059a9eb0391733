"""Pace of strangers: requests without a caller take little of the event loop that all callers share."""

from __future__ import annotations

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..auth.rate_limit import RateLimit
from ..http_server.client_address import address_of
from ..http_server.hold import HOLD, Hold
from ..settings import Settings

STRANGERS_PER_S = 50.0  # of one address: these answers then take a few percent of a core
BURST_S = 2.0  # a page and its files come at once, for several people behind one address
MAX_HOLD_S = 2.0
# Probes give up after a second, and one may share its address with a stranger.
MAX_PROBE_HOLD_S = 0.25
_PROBES = {"/healthz", "/readyz"}


class StrangerPace:
    """ASGI middleware that holds back answers to strangers who ask too fast.

    A stranger has no caller: it asks for the console's page or for health, or its credential is missing or
    invalid. A refusal would take as much time as most of these answers, and the next request would come at
    once. So the answer comes late instead, and nothing fails. Strangers are counted by address.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._trusted = settings.trusted_proxies
        self._others, self._probes = (
            RateLimit(what, STRANGERS_PER_S, BURST_S * STRANGERS_PER_S) for what in ("requests", "probes")
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one request."""
        hold: Hold | None = scope.get("extensions", {}).get(HOLD)
        if hold is None:
            await self._app(scope, receive, send)
            return

        async def send_in_time(message: Message) -> None:
            is_start = message["type"] == "http.response.start"
            if is_start and "caller" not in scope.get("state", {}) and (wait_s := self._wait_s(scope)):
                await hold(wait_s)
            await send(message)

        await self._app(scope, receive, send_in_time)

    def _wait_s(self, scope: Scope) -> float:
        address = address_of(HTTPConnection(scope), self._trusted)
        if scope["path"] in _PROBES:
            return self._probes.owe(address, MAX_PROBE_HOLD_S)
        return self._others.owe(address, MAX_HOLD_S)
