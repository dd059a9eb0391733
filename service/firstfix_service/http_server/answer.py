"""The way of an answer from the cycle of its request to the connection."""

from __future__ import annotations

import asyncio
from typing import Protocol

from uvicorn.protocols.http.httptools_impl import RequestResponseCycle


class AnsweringConnection(Protocol):
    """A connection, as far as answers need it."""

    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport

    @property
    def is_lingering(self) -> bool:
        """True if answers are dropped."""
        ...

    def end_after_answer(self) -> None:
        """Closes the connection after an answer."""
        ...


class AnswerTransport:
    """The transport that one request and its answer use.

    The head of an answer waits for the first piece of its body, and both go out in one write. So if the
    service is killed, a proxy has seen all of a short answer or nothing, and may ask another replica. Between
    two writes it could pass on a head that no body follows. A head alone goes out in the loop's next turn.
    """

    def __init__(self, connection: AnsweringConnection, cycle: RequestResponseCycle) -> None:
        self._connection = connection
        self._cycle = cycle
        self._head: bytes | None = None
        self._head_was_written = False

    def write(self, data: bytes) -> None:
        """Writes a head or a piece of a body, unless the connection drops answers."""
        if self._cycle.response_started and not self._head_was_written:  # else 100 Continue, or a body
            self._head_was_written = True
            if self._cycle.scope["method"] != "HEAD":
                self._head = data
                self._connection.loop.call_soon(self._flush)
                return
        head, self._head = self._head or b"", None
        if not self._connection.is_lingering:
            self._connection.transport.write(head + data)

    def is_closing(self) -> bool:
        """Returns True if nothing more can be written."""
        return self._connection.is_lingering or self._connection.transport.is_closing()

    def close(self) -> None:
        """Ends the connection after what was written."""
        self._flush()
        self._connection.end_after_answer()

    def _flush(self) -> None:
        if self._head is not None and not self._connection.transport.is_closing():
            self.write(b"")
