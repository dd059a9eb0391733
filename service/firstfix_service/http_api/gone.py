"""Work for a caller ends when the caller goes."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from starlette.requests import ClientDisconnect
from starlette.types import Scope

from ..http_server.streams import WHEN_GONE, WhenGone

T = TypeVar("T")


async def cancel_when_gone(scope: Scope, work: Coroutine[Any, Any, T]) -> T:
    """The result of the work, or cancels the work when the connection closes.

    Args:
        scope: of a request whose body was read to the end.

    Raises:
        ClientDisconnect: the caller has gone.
    """
    own = asyncio.current_task()
    assert own is not None
    has_gone = False

    def gone() -> None:
        nonlocal has_gone
        has_gone = True
        own.cancel()

    when_gone: WhenGone = scope["extensions"][WHEN_GONE]
    when_gone(gone)
    try:
        return await work
    except asyncio.CancelledError:
        if not has_gone or own.uncancel():  # cancelled by somebody else, too
            raise
        raise ClientDisconnect from None
    finally:
        when_gone(None)
