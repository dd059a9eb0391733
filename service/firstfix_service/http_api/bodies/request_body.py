"""Request bodies: whole ones in memory, and long ones in pieces, with limits of size and time.

The server receives a long body of declared length right into its place (``RECEIVE_INTO``).
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firstfix.errors import DeadlineExceeded, Overloaded, TooLarge
from firstfix.formats.point_cloud import Body

from ...auth.authenticate import CHECK_S, Permission
from ...http_server.streams import ARRIVAL, RECEIVE_INTO, RECEIVED, Arrived, ReceiveInto, declared_bytes
from ...limits.byte_budget import ByteBudget, owners_of_body
from ...limits.limits import Limits

LONG_BYTES = 64 << 10  # of a body that is received right into its place


class BodyReader:
    """Reads bodies up to limits: of each, of a caller, and of all together."""

    def __init__(self, max_bytes: int, budget: ByteBudget, timeout_s: float) -> None:
        self._max_bytes = max_bytes
        self._budget = budget
        self._timeout_s = timeout_s

    async def read_permitted(self, request: Request, caller: str) -> Body:
        """The body of a request that comes without ``WhilePermitted`` around its route, as ``read``.

        Raises:
            FirstfixError: also if the permission ends before the body has come.
        """
        if (received := self._received(request, caller)) is not None:
            return received
        extensions = request.scope.get("extensions", {})
        if ARRIVAL in extensions and 0 < declared_bytes(request.scope["headers"]) < LONG_BYTES:
            await extensions[ARRIVAL](CHECK_S)  # the permission is good for so long
            if (received := self._received(request, caller)) is not None:
                return received
        if (declared := self._long_bytes(request)) and RECEIVE_INTO in extensions:
            receive_into = partial(PermissionChecks(request.scope).receive_into, extensions[RECEIVE_INTO])
            return await self._limited(partial(_long, receive_into, declared), caller)
        body: list[Body] = []

        async def read(scope: Scope, receive: Receive, send: Send) -> None:
            body.append(await self.read(Request(scope, receive), caller))

        await WhilePermitted(read)(request.scope, request.receive, _nothing_to_send)
        return body[0]

    async def read(self, request: Request, caller: str = "") -> Body:
        """The body. Call ``release`` when it is no longer needed.

        Raises:
            TooLarge: over the limit, by the declared length or by the bytes that arrive.
            Overloaded: all bodies together are too large, or those of this caller.
            DeadlineExceeded: it did not arrive in time.
        """
        if (received := self._received(request, caller)) is not None:
            return received
        extensions = request.scope.get("extensions", {})
        if (declared := self._long_bytes(request)) and RECEIVE_INTO in extensions:
            return await self._limited(partial(_long, extensions[RECEIVE_INTO], declared), caller)
        return await self._limited(partial(_joined, request), caller)

    async def _limited(self, receive: Callable[[Arrived], Awaitable[Body]], caller: str) -> Body:
        """A body that is counted as it arrives, and must do so in time."""
        lease = self._budget.lease(*owners_of_body(caller))

        def arrived(count: int) -> None:
            lease.grow(count)
            if lease.size > self._max_bytes:
                raise _too_large(self._max_bytes)

        try:
            async with asyncio.timeout(self._timeout_s):
                return await receive(arrived)
        except BaseException as error:
            lease.end()
            if isinstance(error, TimeoutError):
                raise DeadlineExceeded(f"the body did not arrive within {self._timeout_s:g} s") from None
            raise

    def _received(self, request: Request, caller: str) -> bytes | None:
        """The body, if all of it came with the head, as ``read``; else None."""
        extensions = request.scope.get("extensions", {})
        is_long = self._long_bytes(request) and RECEIVE_INTO in extensions
        body: bytes | None = None if is_long or RECEIVED not in extensions else extensions[RECEIVED]()
        if body is not None:
            self._budget.lease(*owners_of_body(caller)).grow(len(body))
            if len(body) > self._max_bytes:
                self.release(body, caller)
                raise _too_large(self._max_bytes)
        return body

    def _long_bytes(self, request: Request) -> int:
        """The declared length of a body that may be received right into its place; 0: it is short."""
        declared = checked_length(request, self._max_bytes)
        return declared if declared >= LONG_BYTES else 0

    def release(self, body: Body, caller: str = "") -> None:
        """Take a body out of the count of all bodies."""
        self._budget.give_back(owners_of_body(caller), len(body))


async def _long(receive_into: ReceiveInto, declared: int, arrived: Arrived) -> Body:
    """A body in memory of its declared length. The system provides that memory as the bytes arrive."""
    try:
        buffer = np.empty(declared, np.uint8).data
    except MemoryError:
        raise Overloaded("there is no memory for the body: try again") from None
    await receive_into(buffer, arrived)
    return buffer


async def _joined(request: Request, arrived: Arrived) -> bytes:
    parts = []
    async for part in request.stream():
        arrived(len(part))
        parts.append(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _too_large(max_bytes: int) -> TooLarge:
    return TooLarge(f"the body has over {max_bytes} bytes")


async def _nothing_to_send(message: Message) -> None:
    raise AssertionError("a reader of bodies answers nothing")


def checked_length(request: Request, max_bytes: int) -> int:
    """Content-Length, or 0 without that header. The server has checked that it is a number.

    Raises:
        TooLarge: over the limit.
    """
    declared = int(dict(request.scope["headers"]).get(b"content-length", 0))
    if declared > max_bytes:
        raise TooLarge(f"the body has {declared} bytes, the limit is {max_bytes}")
    return declared


class PermissionChecks:
    """Checks the permission of a request again and again while its body arrives."""

    def __init__(self, scope: Scope) -> None:
        self._scope = scope
        self._checked_at = time.monotonic()

    async def check(self) -> None:
        """Check the permission, if the last time is long ago.

        Raises:
            FirstfixError: it has ended.
        """
        permission: Permission | None = self._scope.get("state", {}).get("permission")
        if permission is not None and time.monotonic() - self._checked_at >= CHECK_S:
            await permission.check()
            self._checked_at = time.monotonic()

    async def receive_into(self, receive_into: ReceiveInto, buffer: memoryview, arrived: Arrived) -> None:
        """Receive a long body, as ``receive_into``, while the permission lasts."""
        refusal: list[Exception] = []
        own = asyncio.current_task()
        assert own is not None

        async def go_on_checking() -> None:
            try:
                while True:
                    await self.check()
                    await asyncio.sleep(CHECK_S)
            except Exception as error:
                refusal.append(error)
                own.cancel()

        checking: list[asyncio.Task[None]] = []  # most bodies have come before the first check
        loop = asyncio.get_running_loop()
        timer = loop.call_later(CHECK_S, lambda: checking.append(loop.create_task(go_on_checking())))
        try:
            await receive_into(buffer, arrived)
        except asyncio.CancelledError:
            if not refusal or own.uncancel():  # cancelled by somebody else, too
                raise
            raise refusal[0] from None
        finally:
            timer.cancel()
            for task in checking:
                task.cancel()


class WhilePermitted:
    """ASGI middleware that raises in the reader of a request body when the permission has ended."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request."""
        checks = PermissionChecks(scope)

        async def receive_while_permitted() -> Message:
            message = await receive()
            if message["type"] == "http.request":
                await checks.check()
            return message

        extensions = scope.get("extensions", {})
        if RECEIVE_INTO in extensions:
            receive_into = partial(checks.receive_into, extensions[RECEIVE_INTO])
            scope["extensions"] = {**extensions, RECEIVE_INTO: receive_into}
        await self._app(scope, receive_while_permitted, send)


@dataclass(frozen=True)
class Pace:
    """Minimum pace of a body. Only the time in which the service waits for the sender counts.

    Attributes:
        stall_s: limit without a single byte. The mean rate is measured over windows of this length.
        min_bytes_per_s: lowest mean rate.
        timeout_s: limit of the whole body.
    """

    stall_s: float
    min_bytes_per_s: int = Limits.file_bytes_per_s
    timeout_s: float = Limits.file_timeout_s


async def paced_pieces(request: Request, pace: Pace) -> AsyncIterator[bytes]:
    """Yield the pieces of a request's body as they arrive.

    Raises:
        DeadlineExceeded: the body is too slow.
        ClientDisconnect: the caller has gone.
    """
    stream = aiter(request.stream())
    waited_s = window_s = 0.0
    window_bytes = 0
    while True:
        asked = time.monotonic()
        try:
            async with asyncio.timeout(min(pace.stall_s, pace.timeout_s - waited_s)):
                piece = await anext(stream)
        except StopAsyncIteration:
            return
        except TimeoutError:
            raise _too_slow(pace, waited_s + pace.stall_s >= pace.timeout_s) from None
        took_s = time.monotonic() - asked
        waited_s += took_s
        window_s += took_s
        window_bytes += len(piece)
        if waited_s >= pace.timeout_s:
            raise _too_slow(pace, True)
        if window_s >= pace.stall_s:
            if window_bytes < pace.min_bytes_per_s * window_s:
                raise DeadlineExceeded(
                    f"the body arrives with {window_bytes / window_s:.0f} bytes/s, the minimum is "
                    f"{pace.min_bytes_per_s}"
                )
            window_s, window_bytes = 0.0, 0
        yield piece


def _too_slow(pace: Pace, in_all: bool) -> DeadlineExceeded:
    if in_all:
        return DeadlineExceeded(f"the body did not arrive within {pace.timeout_s:g} s")
    return DeadlineExceeded(f"no byte of the body arrived for {pace.stall_s:g} s")
