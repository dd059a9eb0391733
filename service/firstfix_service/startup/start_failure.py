"""A service that cannot start says why in one line: the operator's mistake is no defect to trace."""

from __future__ import annotations

import sys

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firstfix.errors import FirstfixError


class StartFailure:
    """ASGI middleware around the lifespan: one of our errors in place of its traceback."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "lifespan":
            await self._app(scope, receive, send)
            return

        async def send_plainly(message: Message) -> None:
            error = sys.exc_info()[1]  # the framework tells of it from its except block
            if message["type"] == "lifespan.startup.failed" and isinstance(error, FirstfixError):
                message = {**message, "message": f"cannot start: {error} ({error.code})"}
            await send(message)

        await self._app(scope, receive, send_plainly)
