"""The response budget: bytes of large answers in memory, until callers have taken them in."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firstfix.errors import FirstfixError

from ..http_server.streams import PIECE_BYTES, declared_bytes
from ..limits.byte_budget import ByteBudget, Lease, Owner
from ..problems import problem_of
from ..telemetry.request_scope import current_caller
from .edge import needs_of


class ResponseLease:
    """The part of the response budget that one request's answer takes."""

    def __init__(self, budget: ByteBudget, scope: Scope) -> None:
        self._budget = budget
        self._scope = scope
        self._lease: Lease | None = None

    def take(self, size_bytes: int) -> None:
        """Take room for a body of this size, before it is read into memory. Short bodies need none.

        Raises:
            QuotaExceeded: the caller, or its address, has not taken in its other answers.
            Overloaded: nor have all callers together.
        """
        if size_bytes <= PIECE_BYTES:
            return
        if self._lease is None:
            address = str(self._scope["state"]["address"])
            caller = current_caller() or f"unauthenticated:{address}"
            self._lease = self._budget.lease(Owner("caller", caller, 4), Owner("address", address, 2))
        if size_bytes > self._lease.size:
            self._lease.grow(size_bytes - self._lease.size)

    def end(self) -> None:
        """Give the room back: the caller has taken the answer in, or has gone."""
        if self._lease is not None:
            self._lease.end()


class CountedAnswers:
    """ASGI middleware that refuses a large answer while there is no room for it.

    A route that knows the size of its answer takes the room itself, before it reads the answer.
    """

    def __init__(self, app: ASGIApp, budget: ByteBudget) -> None:
        self._app = app
        self._budget = budget

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        lease = ResponseLease(self._budget, scope)
        scope.setdefault("state", {})["response_lease"] = lease
        is_refused = False

        async def send_if_there_is_room(message: Message) -> None:
            nonlocal is_refused
            if is_refused:
                return
            if message["type"] == "http.response.start" and _is_counted(scope):
                try:
                    lease.take(declared_bytes(message["headers"]))
                except FirstfixError as error:
                    is_refused = True
                    await problem_of(error).response()(scope, receive, send)
                    return
            await send(message)

        try:
            await self._app(scope, receive, send_if_there_is_room)
        finally:
            lease.end()


def _is_counted(scope: Scope) -> bool:
    """False for public answers, which are in memory once, for all callers, and for those without a body."""
    return scope["method"] != "HEAD" and needs_of(scope) is not None


async def _lease_of(request: Request) -> ResponseLease:
    """Dependency of routes: the lease of the request's answer."""
    lease: ResponseLease = request.state.response_lease
    return lease


ResponseLeaseDep = Annotated[ResponseLease, Depends(_lease_of)]
