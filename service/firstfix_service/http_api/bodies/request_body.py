"""Request bodies in memory, with limits of their size and of the time to send them."""

from __future__ import annotations

import asyncio

from fastapi import Request

from firstfix.errors import DeadlineExceeded, InputError, Overloaded, TooLarge


class BodyReader:
    """Reads bodies up to a limit for each and a limit for all together. Belongs to one event loop."""

    def __init__(self, max_bytes: int, max_inflight_bytes: int, timeout_s: float) -> None:
        self._max_bytes = max_bytes
        self._max_inflight_bytes = max_inflight_bytes
        self._timeout_s = timeout_s
        self.inflight_bytes = 0

    async def read(self, request: Request) -> bytes:
        """Returns the body. Call ``release`` when it is no longer needed.

        Raises:
            TooLarge: over the limit, by the declared length or by the bytes that arrive.
            Overloaded: all bodies together are too large.
            DeadlineExceeded: it did not arrive in time.
        """
        check_declared_length(request, self._max_bytes)
        parts: list[bytes] = []
        size = 0
        try:
            async with asyncio.timeout(self._timeout_s):
                async for part in request.stream():
                    size += len(part)
                    self.inflight_bytes += len(part)
                    parts.append(part)
                    if size > self._max_bytes:
                        raise TooLarge(f"the body has over {self._max_bytes} bytes")
                    if self.inflight_bytes > self._max_inflight_bytes:
                        raise Overloaded("too many bodies arrive at the same time: try again")
        except BaseException as error:
            self.inflight_bytes -= size
            if isinstance(error, TimeoutError):
                raise DeadlineExceeded(f"the body did not arrive within {self._timeout_s:g} s") from None
            raise
        return b"".join(parts)

    def release(self, body: bytes) -> None:
        """Takes a body out of the count of all bodies."""
        self.inflight_bytes -= len(body)


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
