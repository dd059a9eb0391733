"""Reception of a long body into memory that waits for it, without the parser's pieces and copies."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

RECEIVE_INTO = "firstfix.receive_into"  # extension of the ASGI scope: a ``ReceiveInto``

Arrived = Callable[[int], None]
"""Called with the number of bytes of each piece. An error that it raises ends the reception."""
ReceiveInto = Callable[[memoryview, Arrived], Awaitable[None]]
"""Receives a whole body of declared length into a buffer of that length, once, instead of ``receive``.

Raises ClientDisconnect if the caller goes, or the error of ``Arrived``.
"""


class ReceivingConnection(Protocol):
    """The connection whose body is received."""

    def body_ended(self, error: Exception | None) -> None:
        """Reads by itself again: the body is complete, or it cannot be taken."""

    def connection_lost(self, exc: Exception | None) -> None:
        """See ``asyncio.Protocol``."""

    def eof_received(self) -> bool:
        """See ``asyncio.Protocol``."""

    def pause_writing(self) -> None:
        """See ``asyncio.Protocol``."""

    def resume_writing(self) -> None:
        """See ``asyncio.Protocol``."""


class BodyReceiver(asyncio.BufferedProtocol):
    """Takes the connection's place at its transport until the body is complete.

    Args:
        buffer: the rest of the body's memory; not empty.
    """

    def __init__(self, connection: ReceivingConnection, buffer: memoryview, arrived: Arrived) -> None:
        self._connection = connection
        self._left = buffer
        self._arrived = arrived

    def get_buffer(self, sizehint: int) -> memoryview:
        """Returns the memory for the next bytes."""
        return self._left

    def buffer_updated(self, nbytes: int) -> None:
        """Counts bytes that came."""
        self._left = self._left[nbytes:]
        try:
            self._arrived(nbytes)
        except Exception as error:
            self._connection.body_ended(error)
            return
        if not self._left:
            self._connection.body_ended(None)

    def eof_received(self) -> bool:
        """The caller sends no more."""
        return self._connection.eof_received()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection was closed."""
        self._connection.connection_lost(exc)

    def pause_writing(self) -> None:
        """The caller does not read."""
        self._connection.pause_writing()

    def resume_writing(self) -> None:
        """The caller reads again."""
        self._connection.resume_writing()
