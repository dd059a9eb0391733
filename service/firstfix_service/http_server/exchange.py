"""One request and its answer: long bodies go out in pieces, short answers in one write."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, RequestResponseCycle
from uvicorn.server import ServerState

from .streams import PIECE_BYTES, ReadingPace, declared_bytes


class AnsweringConnection(Protocol):
    """A connection as its exchanges use it.

    Attributes:
        logger, access_logger, access_log, server_state: of uvicorn.
        expect_100_continue: of the request that has just come.
        pace: measures how fast the caller reads.
    """

    logger: logging.Logger
    access_logger: logging.Logger
    access_log: bool
    server_state: ServerState
    expect_100_continue: bool
    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    flow: FlowControl
    pace: ReadingPace

    @property
    def drops_answers(self) -> bool:
        """True if nothing more is sent."""

    def answer_begins(self, size_bytes: int) -> None:
        """An answer begins, of so many bytes; 0: nobody knows."""

    def end_after_answer(self) -> None:
        """Close the connection after an answer."""

    def on_response_complete(self) -> None:
        """Wait for the next request."""


class Exchange(RequestResponseCycle):
    """uvicorn's request and answer, on a connection that may drop answers and callers that read slowly."""

    def __init__(self, connection: AnsweringConnection, scope: Any) -> None:
        super().__init__(
            scope=scope,
            transport=AnswerTransport(connection, self),  # type: ignore[arg-type]
            flow=connection.flow,
            message_event=asyncio.Event(),
            keep_alive=False,  # an answer before the end of the body closes the connection, and says so
            on_response=connection.on_response_complete,
            logger=connection.logger,
            access_logger=connection.access_logger,
            access_log=connection.access_log,
            default_headers=connection.server_state.default_headers,
            expect_100_continue=connection.expect_100_continue,
        )
        self._connection = connection
        self._arrived: asyncio.Future[None] | None = None  # of who waits for the body
        self._gone: Callable[[], None] | None = None  # of who waits for the caller's end

    def received(self) -> bytes | None:
        """See ``Received``."""
        if self.more_body or self.disconnected or self.response_complete or self.waiting_for_100_continue:
            return None
        if self.flow.read_paused:
            self.flow.resume_reading()
        body, self.body = bytes(self.body), bytearray()
        return body

    async def arrival(self, within_s: float) -> None:
        """See ``Arrival``."""
        if self.waiting_for_100_continue or self.disconnected or not self.more_body:
            return
        self._arrived = self._connection.loop.create_future()
        timer = self._connection.loop.call_later(within_s, self.end_wait)
        try:
            await self._arrived
        finally:
            timer.cancel()
            self._arrived = None

    def end_wait(self) -> None:
        """End the wait for the body, if somebody waits."""
        if self._arrived is not None and not self._arrived.done():
            self._arrived.set_result(None)

    def when_gone(self, call: Callable[[], None] | None) -> None:
        """See ``WhenGone``."""
        self._gone = call
        if self.disconnected:
            self.tell_gone()

    def tell_gone(self) -> None:
        """Tell who waits for the body or the caller's end, if the caller has gone."""
        self.end_wait()
        if self.disconnected and self._gone is not None:
            gone, self._gone = self._gone, None
            gone()

    async def send(self, message: Any) -> None:
        """Send a message of the answer, a long body in pieces, as the caller takes them in.

        One long write would keep the event loop from all other callers. Between two pieces they have their
        turn, and a piece waits until the transport has room for it.
        """
        if message["type"] == "http.response.start":
            await super().send(message)
            self._connection.answer_begins(declared_bytes(message["headers"]))
            return
        body = memoryview(message.get("body", b""))
        while len(body) > PIECE_BYTES:
            piece: Any = {**message, "body": body[:PIECE_BYTES], "more_body": True}
            await super().send(piece)
            body = body[PIECE_BYTES:]
            await asyncio.sleep(0)
        rest: Any = {**message, "body": body}
        await super().send(rest)

    def answer_whole(self, status: int, headers: Iterable[tuple[bytes, bytes]], body: bytes) -> bool:
        """See ``AnswerWhole``. It does what the two messages of an answer do."""
        if (
            len(body) > PIECE_BYTES
            or self.flow.write_paused
            or self.disconnected
            or self.response_started
            or self.scope["method"] == "HEAD"
        ):
            return False
        lines = [STATUS_LINE[status]]
        for name, value in (*self.default_headers, *headers):
            if name == b"connection" or b"\r" in value or b"\n" in value:  # ``send`` knows what to do
                return False
            lines.append(b"%s: %s\r\n" % (name, value))
        if not self.keep_alive:
            lines.append(b"connection: close\r\n")
        self.response_started, self.waiting_for_100_continue = True, False
        self._connection.answer_begins(len(body))
        transport: Any = self.transport
        transport.write_whole(b"".join((*lines, b"\r\n", body)))
        self.response_complete = True
        self.message_event.set()
        if not self.keep_alive:
            transport.close()
        self.on_response()
        return True


class AnswerTransport:
    """The transport that one request and its answer use.

    The head of an answer waits for the first piece of its body, and both go out in one write. So if the
    service is killed, a proxy has seen all of a short answer or nothing, and may ask another replica. Between
    two writes it could pass on a head that no body follows. A head alone goes out in the loop's next turn.

    """

    def __init__(self, connection: AnsweringConnection, exchange: Exchange) -> None:
        self._connection = connection
        self._exchange = exchange
        self._head: bytes | None = None
        self._head_was_written = False

    def write(self, data: bytes | memoryview) -> None:
        """Write a head or a piece of a body, unless the connection drops answers."""
        if self._exchange.response_started and not self._head_was_written:  # else 100 Continue, or a body
            self._head_was_written = True
            if self._exchange.scope["method"] != "HEAD":
                self._head = bytes(data)
                self._connection.loop.call_soon(self._flush)
                return
        head, self._head = self._head or b"", None
        if not self._connection.drops_answers:
            self._connection.pace.wrote(len(head) + len(data))
            self._connection.transport.write(head + data if head else data)

    def write_whole(self, data: bytes) -> None:
        """Write a head and all of its body, unless the connection drops answers."""
        self._head_was_written = True
        if not self._connection.drops_answers:
            self._connection.pace.wrote(len(data))
            self._connection.transport.write(data)

    def is_closing(self) -> bool:
        """True if nothing more can be written."""
        return self._connection.drops_answers or self._connection.transport.is_closing()

    def close(self) -> None:
        """End the connection after what was written."""
        self._flush()
        self._connection.end_after_answer()

    def _flush(self) -> None:
        if self._head is not None and not self._connection.transport.is_closing():
            self.write(b"")
