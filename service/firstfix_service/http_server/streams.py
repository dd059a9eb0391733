"""The way of an answer from the app over the cycle of its request to the connection."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from uvicorn.protocols.http.httptools_impl import RequestResponseCycle

from .reading_pace import ReadingPace

PIECE_BYTES = 64 << 10  # of a body, in one write
App = Callable[[Any, Any, Any], Any]  # ASGI


def in_pieces(app: App, begins: Callable[[int], None]) -> App:
    """Returns an app whose long bodies go out in pieces, as the caller takes them in.

    One long write would keep the event loop from all other callers. Between two pieces they have their turn,
    and a piece waits until the transport has room for it.

    Args:
        begins: called when an answer begins, with the length that its head declares, or 0.
    """

    async def answer(scope: Any, receive: Any, send: Any) -> None:
        async def send_in_pieces(message: Any) -> None:
            if message["type"] == "http.response.start":
                await send(message)
                begins(declared_bytes(message["headers"]))
                return
            body = memoryview(message.get("body", b""))
            while len(body) > PIECE_BYTES:
                await send({**message, "body": body[:PIECE_BYTES], "more_body": True})
                body = body[PIECE_BYTES:]
                await asyncio.sleep(0)
            await send({**message, "body": body})

        await app(scope, receive, send_in_pieces)

    return answer


def declared_bytes(headers: Iterable[tuple[bytes, bytes]]) -> int:
    """Returns the Content-Length, or 0."""
    return next((int(value) for name, value in headers if name.lower() == b"content-length"), 0)


def limit_kernel_buffer(connection: socket.socket | None) -> None:
    """Bounds what the system holds of answers beyond that which is on its way to the caller.

    Otherwise it takes up to 4 MB of each connection: as memory, and as if the caller had read it.
    """
    if connection is not None and hasattr(socket, "TCP_NOTSENT_LOWAT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, 2 * PIECE_BYTES)


class AnsweringConnection(Protocol):
    """A connection, as far as answers need it."""

    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    pace: ReadingPace

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

    def write(self, data: bytes | memoryview) -> None:
        """Writes a head or a piece of a body, unless the connection drops answers."""
        if self._cycle.response_started and not self._head_was_written:  # else 100 Continue, or a body
            self._head_was_written = True
            if self._cycle.scope["method"] != "HEAD":
                self._head = bytes(data)
                self._connection.loop.call_soon(self._flush)
                return
        head, self._head = self._head or b"", None
        if not self._connection.is_lingering:
            self._connection.pace.wrote(len(head) + len(data))
            self._connection.transport.write(head + data if head else data)

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
