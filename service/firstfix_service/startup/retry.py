"""Start of the service with retries: the process stays up, not ready, while the store does not answer."""

from __future__ import annotations

import asyncio
import random
import sys
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack, suppress
from types import TracebackType

import structlog
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firstfix.errors import FirstfixError, StoreError, StoreUnavailable

from ..http_api.parts import Parts

_log = structlog.get_logger(__name__)
FIRST_TRY_S = 5.0  # after this time the process listens and says that it is not ready
FIRST_WAIT_S = 1.0  # between two tries; it doubles
MAX_WAIT_S = 15.0


class RetryingStart:
    """Composes the parts of the service, with retries, and stops them at the exit.

    While the store does not answer the process waits, because an orchestrator would only restart it again and
    again. Any other error within ``FIRST_TRY_S`` ends the process. After that time the process listens: it
    answers requests with the error, and retries only errors of the store.

    Args:
        compose: starts the parts in order, and pushes what stops them onto the stack.
    """

    def __init__(self, compose: Callable[[AsyncExitStack], Awaitable[Parts]]) -> None:
        self._compose = compose
        self._stack = AsyncExitStack()
        self._parts: Parts | None = None
        self._error: Exception = StoreUnavailable("the object store has not answered yet")
        self._retrying: asyncio.Task[None] | None = None

    @property
    def parts(self) -> Parts:
        """The parts of the service.

        Raises:
            FirstfixError: the service has not started; the error says why.
        """
        if self._parts is None:
            raise self._error.with_traceback(None)  # the same error is raised again and again
        return self._parts

    async def __aenter__(self) -> RetryingStart:
        """Start the service.

        Raises:
            FirstfixError: the service cannot start, and a retry would not help.
        """
        first = asyncio.create_task(self._try())
        await asyncio.wait({first}, timeout=FIRST_TRY_S)
        if not first.done() or isinstance(first.exception(), StoreUnavailable):
            self._retrying = asyncio.create_task(self._retry(first), name="start")
        else:
            first.result()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._retrying is not None:
            self._retrying.cancel()
            with suppress(asyncio.CancelledError):
                await self._retrying
        await self._stack.aclose()

    async def _retry(self, attempt: asyncio.Task[None]) -> None:
        wait_s = FIRST_WAIT_S
        while True:
            try:
                await attempt
                return
            except StoreError as error:
                self._error = error
                _log.warning("cannot start yet", code=error.code, error=str(error))
            except Exception as error:
                self._error = error
                _log.exception("cannot start")
                return
            await asyncio.sleep(random.uniform(wait_s / 2, wait_s))  # replicas must not retry all at once
            wait_s = min(2 * wait_s, MAX_WAIT_S)
            attempt = asyncio.create_task(self._try())

    async def _try(self) -> None:
        async with AsyncExitStack() as stack:
            self._parts = await self._compose(stack)
            self._stack = stack.pop_all()


class PlainStartError:
    """ASGI middleware that reports a failed start in one line instead of a traceback.

    Such an error is a mistake of the operator, not a defect of the service.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or the lifespan."""
        if scope["type"] != "lifespan":
            await self._app(scope, receive, send)
            return

        async def send_plainly(message: Message) -> None:
            error = sys.exc_info()[1]  # the framework sends this message from its except block
            if message["type"] == "lifespan.startup.failed" and isinstance(error, FirstfixError):
                message = {**message, "message": f"cannot start: {error} ({error.code})"}
            await send(message)

        await self._app(scope, receive, send_plainly)
