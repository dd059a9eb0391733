"""Work that is cancelled when its caller disconnects."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from fastapi import Request
from starlette.requests import ClientDisconnect

T = TypeVar("T")


async def cancel_on_disconnect(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """Returns the result of the work, or cancels the work when the connection closes.

    Args:
        request: its body was read to the end.

    Raises:
        ClientDisconnect: the caller has gone.
    """
    own = asyncio.current_task()
    assert own is not None
    has_gone = False

    async def watch() -> None:
        nonlocal has_gone
        while (await request.receive())["type"] != "http.disconnect":
            pass
        has_gone = True
        own.cancel()

    watching = asyncio.ensure_future(watch())
    try:
        return await work
    except asyncio.CancelledError:
        if not has_gone or own.uncancel():  # cancelled by somebody else, too
            raise
        raise ClientDisconnect from None
    finally:
        watching.cancel()
