"""Starting while the store does not answer: the process stays up, not ready, and tries again."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack, suppress
from types import TracebackType

import structlog

from firstfix.errors import StoreError, StoreUnavailable

from ..http_api.dependencies import Parts

_log = structlog.get_logger(__name__)
FIRST_TRY_S = 5.0  # then the process listens and says that it is not ready
FIRST_WAIT_S = 1.0  # between two tries; it doubles
MAX_WAIT_S = 15.0


class Start:
    """Makes the parts, at once or as soon as it can be done; what was started is stopped at the exit.

    A store that does not answer is waited for: ending the process would only have it restarted, again and
    again. Anything else ends it, with its reason, if it is known within ``FIRST_TRY_S``; later it is told to
    whoever asks, and only what the store said is tried again.

    Args:
        make: starts everything in order and gives the stack what stops it again.
    """

    def __init__(self, make: Callable[[AsyncExitStack], Awaitable[Parts]]) -> None:
        self._make = make
        self._stack = AsyncExitStack()
        self._parts: Parts | None = None
        self._error: Exception = StoreUnavailable("the object store has not answered yet")
        self._trying: asyncio.Task[None] | None = None

    @property
    def parts(self) -> Parts:
        """
        Raises:
            FirstfixError: why they are not there yet.
        """
        if self._parts is None:
            raise self._error.with_traceback(None)  # it is raised again and again
        return self._parts

    async def __aenter__(self) -> Start:
        """
        Raises:
            FirstfixError: what waiting does not mend.
        """
        first = asyncio.create_task(self._try())
        await asyncio.wait({first}, timeout=FIRST_TRY_S)
        if not first.done() or isinstance(first.exception(), StoreUnavailable):
            self._trying = asyncio.create_task(self._go_on(first), name="start")
        else:
            first.result()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._trying is not None:
            self._trying.cancel()
            with suppress(asyncio.CancelledError):
                await self._trying
        await self._stack.aclose()

    async def _go_on(self, attempt: asyncio.Task[None]) -> None:
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
            await asyncio.sleep(random.uniform(wait_s / 2, wait_s))  # replicas must not come back together
            wait_s = min(2 * wait_s, MAX_WAIT_S)
            attempt = asyncio.create_task(self._try())

    async def _try(self) -> None:
        async with AsyncExitStack() as stack:
            self._parts = await self._make(stack)
            self._stack = stack.pop_all()
