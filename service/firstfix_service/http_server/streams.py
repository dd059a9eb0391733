"""Streams between the app and a connection: answers at the pace of the caller, long bodies, delays."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Awaitable, Callable, Iterable

from ..limits.limits import Limits

PIECE_BYTES = 64 << 10  # of a body, in one write

DELAY_ANSWER = "firstfix.delay_answer"  # extension of the ASGI scope: a ``DelayAnswer``
DelayAnswer = Callable[[float], Awaitable[bool]]  # seconds; False: the caller has gone meanwhile

RECEIVE_INTO = "firstfix.receive_into"  # extension of the ASGI scope: a ``ReceiveInto``

Arrived = Callable[[int], None]
"""Called with the number of bytes of each piece. An error that it raises ends the reception."""
ReceiveInto = Callable[[memoryview, Arrived], Awaitable[None]]
"""Receives a whole body of declared length into a buffer of that length, once, instead of ``receive``.

Raises ClientDisconnect if the caller goes, or the error of ``Arrived``.
"""


RECEIVED = "firstfix.received"  # extension of the ASGI scope: a ``Received``
Received = Callable[[], bytes | None]
"""The whole body, once, if all of it has arrived; else None, and ``receive`` gives it."""

ARRIVAL = "firstfix.arrival"  # extension of the ASGI scope: an ``Arrival``
Arrival = Callable[[float], Awaitable[None]]
"""Waits until all of the body has arrived, or the caller has gone, but no more seconds than this."""

ANSWER_WHOLE = "firstfix.answer_whole"  # extension of the ASGI scope: an ``AnswerWhole``
AnswerWhole = Callable[[int, Iterable[tuple[bytes, bytes]], bytes], bool]
"""Sends status, headers in lower case with a Content-Length, and a body, in one write.

Returns False, and sends nothing, where it must go by ``send``: it is long, or the caller has to read first.
"""

WHEN_GONE = "firstfix.when_gone"  # extension of the ASGI scope: a ``WhenGone``
WhenGone = Callable[[Callable[[], None] | None], None]
"""Sets what is called, once, when the caller goes before its answer has begun; None: nothing any more."""


def declared_bytes(headers: Iterable[tuple[bytes, bytes]]) -> int:
    """The Content-Length, or 0."""
    for name, value in headers:
        if name.lower() == b"content-length":
            return int(value)
    return 0


def limit_kernel_buffer(connection: socket.socket | None) -> None:
    """Bound what the system holds of answers beyond that which is on its way to the caller.

    Otherwise it takes up to 4 MB of each connection: as memory, and as if the caller had read it.
    """
    if connection is not None and hasattr(socket, "TCP_NOTSENT_LOWAT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, 2 * PIECE_BYTES)


class AnswerDelay:
    """A wait before an answer begins, or before the work for it.

    No work is done for the caller meanwhile, so the connection gives its place to another if one is needed.
    """

    def __init__(self) -> None:
        self._ended = asyncio.Event()
        self._is_under_way = False

    @property
    def is_under_way(self) -> bool:
        """True if an answer waits."""
        return self._is_under_way

    async def wait(self, seconds: float) -> bool:
        """Wait for some seconds. Returns False, at once, when the connection has ended."""
        self._is_under_way = True
        try:
            async with asyncio.timeout(seconds):
                await self._ended.wait()
        except TimeoutError:
            return True
        finally:
            self._is_under_way = False
        return False

    def end(self) -> None:
        """End the wait, because the connection has ended."""
        self._ended.set()


class ReadingPace:
    """Measures the caller of one answer after the other.

    Only the time during which writing is paused counts: otherwise the service has nothing to send. A pause of
    its own for each piece of an answer would not do, because a caller may take one piece in, and stop again.

    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._bytes_per_s = float(limits.min_bytes_per_s)
        self._written_bytes = 0
        self._waited_s = 0.0  # in the pauses that have ended
        self._paused_at: float | None = None

    @property
    def is_paused(self) -> bool:
        """True if the service waits for the caller to take something in."""
        return self._paused_at is not None

    def begin(self, size_bytes: int, unsent_bytes: int) -> None:
        """Begin an answer.

        Args:
            size_bytes: of its body; 0: not known.
            unsent_bytes: that the transport still has to send, of this and earlier answers.
        """
        self._bytes_per_s = max(self._limits.min_bytes_per_s, size_bytes / self._limits.longest_answer_s)
        self._written_bytes = unsent_bytes
        self._waited_s = 0.0

    def wrote(self, count: int) -> None:
        """Counts bytes that were given to the transport."""
        self._written_bytes += count

    def paused(self, now: float) -> None:
        """Note that the transport takes no more, because the caller takes in too little."""
        if self._paused_at is None:
            self._paused_at = now

    def resumed(self, now: float) -> None:
        """Note that the transport takes more."""
        if self._paused_at is not None:
            self._waited_s += now - self._paused_at
            self._paused_at = None

    def is_too_slow(self, now: float, unsent_bytes: int) -> bool:
        """Whether the caller has taken in too little for the time that it had.

        Args:
            unsent_bytes: that the transport still has to send.
        """
        waited_s = self._waited_s + (0.0 if self._paused_at is None else now - self._paused_at)
        taken_bytes = max(0, self._written_bytes - unsent_bytes)
        return waited_s > self._limits.answer_timeout_s + taken_bytes / self._bytes_per_s


class Receiver(asyncio.BufferedProtocol):
    """The protocol of a transport: a long body goes right to its place, other bytes to the connection.

    Args:
        room: for these other bytes. The connections of an event loop share it: each takes them at once.
    """

    def __init__(self, connection: asyncio.Protocol, room: memoryview) -> None:
        self._connection = connection
        self._room = room
        self._left: memoryview | None = None  # of the body's memory
        self._arrived: Arrived
        self._ended: Callable[[Exception | None], None]

    def receive_body(
        self, buffer: memoryview, arrived: Arrived, ended: Callable[[Exception | None], None]
    ) -> None:
        """Fill the rest of a body's memory with what comes next.

        Args:
            buffer: not empty.
            ended: called once, with the error of ``arrived`` if there is one, unless ``stop`` comes first.
        """
        self._left, self._arrived, self._ended = buffer, arrived, ended

    def stop(self) -> None:
        """Give all that comes next to the connection."""
        self._left = None

    def get_buffer(self, sizehint: int) -> memoryview:
        """The memory for the next bytes."""
        return self._room if self._left is None else self._left

    def buffer_updated(self, nbytes: int) -> None:
        """Take bytes that came."""
        if self._left is None:
            self._connection.data_received(bytes(self._room[:nbytes]))
            return
        self._left = self._left[nbytes:]
        try:
            self._arrived(nbytes)
        except Exception as error:
            self._ended(error)
            return
        if not self._left:
            self._ended(None)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection was opened."""
        self._connection.connection_made(transport)

    def eof_received(self) -> bool | None:
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
