"""Request bodies in memory, with limits of their size and of the time to send them.

The server receives a long body of declared length right into its place (``RECEIVE_INTO``).
"""

from __future__ import annotations

import asyncio

import numpy as np
from fastapi import Request

from firstfix.errors import DeadlineExceeded, InputError, Overloaded, TooLarge
from firstfix.formats.point_cloud import Body

from ...auth.permission import CHECK_S, Permission
from ...http_server.body_receiver import RECEIVE_INTO, Arrived
from ...localize.query_gate import HeldBodies

LONG_BYTES = 64 << 10  # of a body that is received right into its place


class BodyReader:
    """Reads bodies up to limits: of each, of a caller, and of all together."""

    def __init__(self, max_bytes: int, held: HeldBodies, timeout_s: float) -> None:
        self._max_bytes = max_bytes
        self._held = held
        self._timeout_s = timeout_s

    async def read(self, request: Request, caller: str = "") -> Body:
        """Returns the body. Call ``release`` when it is no longer needed.

        Raises:
            TooLarge: over the limit, by the declared length or by the bytes that arrive.
            Overloaded: all bodies together are too large, or those of this caller.
            DeadlineExceeded: it did not arrive in time.
        """
        check_declared_length(request, self._max_bytes)
        declared = declared_length(request) or 0
        is_long = declared >= LONG_BYTES and RECEIVE_INTO in request.scope.get("extensions", {})
        size = 0

        def arrived(count: int) -> None:
            nonlocal size
            self._held.add(caller, count, body_bytes=size + count)
            size += count
            if size > self._max_bytes:
                raise TooLarge(f"the body has over {self._max_bytes} bytes")

        try:
            async with asyncio.timeout(self._timeout_s):
                return await (_long(request, declared, arrived) if is_long else _joined(request, arrived))
        except BaseException as error:
            self._held.give_back(caller, size)
            if isinstance(error, TimeoutError):
                raise DeadlineExceeded(f"the body did not arrive within {self._timeout_s:g} s") from None
            raise

    def release(self, body: Body, caller: str = "") -> None:
        """Takes a body out of the count of all bodies."""
        self._held.give_back(caller, len(body))


async def _long(request: Request, declared: int, arrived: Arrived) -> Body:
    """A body in memory of its declared length. The system provides that memory as the bytes arrive.

    The permission is checked meanwhile, as ``WhilePermitted`` does it for other bodies.
    """
    try:
        buffer = np.empty(declared, np.uint8).data
    except MemoryError:
        raise Overloaded("there is no memory for the body: try again") from None
    receiving = asyncio.ensure_future(request.scope["extensions"][RECEIVE_INTO](buffer, arrived))
    permission: Permission | None = getattr(request.state, "permission", None)
    try:
        while not (await asyncio.wait({receiving}, timeout=CHECK_S))[0]:
            if permission is not None:
                await permission.check()
        receiving.result()
    finally:
        receiving.cancel()
    return buffer


async def _joined(request: Request, arrived: Arrived) -> bytes:
    parts = []
    async for part in request.stream():
        arrived(len(part))
        parts.append(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def declared_length(request: Request) -> int | None:
    """Returns Content-Length, or None without that header.

    Raises:
        InputError: it is not a number.
    """
    declared = request.headers.get("content-length")
    if declared is None:
        return None
    if not (declared.isascii() and declared.isdecimal()) or len(declared) > 18:
        raise InputError("Content-Length is not a number")
    return int(declared)


def check_declared_length(request: Request, max_bytes: int) -> None:
    """Checks Content-Length before the body is read.

    Raises:
        TooLarge: over the limit.
    """
    declared = declared_length(request)
    if declared is not None and declared > max_bytes:
        raise TooLarge(f"the body has {declared} bytes, the limit is {max_bytes}")
