"""Reading a request's body without letting a caller fill the memory or keep it forever."""

from __future__ import annotations

import asyncio

from fastapi import Request

from firstfix.errors import DeadlineExceeded, InputError, Overloaded, TooLarge


class BodyReader:
    """Reads bodies up to a limit each, and up to a limit together. One event loop's."""

    def __init__(self, max_bytes: int, max_inflight_bytes: int, timeout_s: float) -> None:
        self._max_bytes = max_bytes
        self._max_inflight_bytes = max_inflight_bytes
        self._timeout_s = timeout_s
        self.inflight_bytes = 0

    async def read(self, request: Request) -> bytes:
        """The body. The caller gives its bytes back with ``release`` when it has done with them.

        Raises:
            TooLarge: over the limit, by its declared length or as it arrives.
            Overloaded: all bodies together would take too much.
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
        self.inflight_bytes -= len(body)


def declared_length(request: Request) -> int | None:
    """Content-Length; None: the body is sent without saying how long it is.

    Raises:
        InputError: it is no number.
    """
    declared = request.headers.get("content-length")
    if declared is None:
        return None
    if not (declared.isascii() and declared.isdecimal()) or len(declared) > 18:
        raise InputError("Content-Length is no number")
    return int(declared)


def check_declared_length(request: Request, max_bytes: int) -> None:
    """
    Raises:
        TooLarge: Content-Length says so: nothing of the body is read.
    """
    declared = declared_length(request)
    if declared is not None and declared > max_bytes:
        raise TooLarge(f"the body has {declared} bytes, the limit is {max_bytes}")
