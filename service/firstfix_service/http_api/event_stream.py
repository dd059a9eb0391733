"""Responses of server-sent events."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import ExitStack

from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

HEARTBEAT = b": still there\n\n"
HEARTBEAT_S = 15.0  # proxies close idle connections


class EventStream(StreamingResponse):
    """A stream that counts as a request under way until it ends."""

    def __init__(self, events: AsyncIterator[bytes], counted: ExitStack) -> None:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(events, media_type="text/event-stream", headers=headers)
        self._counted = counted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves the stream."""
        with self._counted:
            await super().__call__(scope, receive, send)
