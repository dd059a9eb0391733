"""Server-sent events, until the service stops or the permission of the caller ends."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AbstractContextManager, ExitStack, suppress
from typing import Annotated

import structlog
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from firstfix.errors import FirstfixError

from ..auth.authenticate import CHECK_S, Permission
from ..limits.concurrency_limit import ConcurrencyLimit
from .parts import part

_log = structlog.get_logger(__name__)
HEARTBEAT = b": still there\n\n"
HEARTBEAT_S = 15.0  # proxies close idle connections


class EventStreams:
    """The streams of events under way.

    Args:
        closing: set when the service begins to stop. Streams end then.
    """

    def __init__(self, limit: ConcurrencyLimit, closing: asyncio.Event) -> None:
        self.limit = limit
        self._closing = closing

    def open(
        self,
        caller: str,
        permission: Permission,
        map_id: str | None,
        events: AsyncIterator[bytes],
        look_s: float,
        *watched: AbstractContextManager[None],
    ) -> StreamingResponse:
        """A stream of events, which counts as a request under way until it ends.

        Args:
            map_id: that the permission must cover, if any.
            events: empty bytes mean that the next look is due after ``look_s``.
            watched: entered until the stream ends.

        Raises:
            QuotaExceeded, Overloaded: see ``ConcurrencyLimit.request``.
        """
        counted = ExitStack()
        for one in (self.limit.request(caller), *watched):
            counted.enter_context(one)
        return _EventStream(self._sent(permission, map_id, events, look_s), counted)

    async def _sent(
        self, permission: Permission, map_id: str | None, events: AsyncIterator[bytes], look_s: float
    ) -> AsyncIterator[bytes]:
        sent = checked = time.monotonic()
        async for event in events:
            if event:
                yield event
                sent = time.monotonic()
                continue
            if time.monotonic() - sent > HEARTBEAT_S:
                yield HEARTBEAT
                sent = time.monotonic()
            with suppress(TimeoutError):
                async with asyncio.timeout(look_s):
                    await self._closing.wait()
            if self._closing.is_set():
                return
            if time.monotonic() - checked < CHECK_S:
                continue
            try:
                await permission.check(map_id)
            except FirstfixError as error:
                _log.info("a stream of events ended: its caller has lost the permission", code=error.code)
                return
            checked = time.monotonic()


class _EventStream(StreamingResponse):
    def __init__(self, events: AsyncIterator[bytes], counted: ExitStack) -> None:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(events, media_type="text/event-stream", headers=headers)
        self._counted = counted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._counted:
            await super().__call__(scope, receive, send)


EventStreamsDep = Annotated[EventStreams, part(EventStreams)]
