"""HTTP/1.1 as uvicorn speaks it, with the limits that it leaves to a proxy: what a caller may send besides a
body, and how long it may take for a head, for a body, for the next request, and to take in an answer."""

from __future__ import annotations

import asyncio
from enum import Enum
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from .connections import Admission, Connections, Ended

MAX_HEAD_BYTES = 64 << 10
MAX_HEADERS = 100
MAX_PIPELINED = 100  # requests that wait for the answer to the one before
MIN_BYTES_PER_S = 500  # of a body, and of an answer: mobile networks at their worst have more
LINGER_S = 5.0  # for a caller to see an answer that came before it had sent its whole body
LINGER_BYTES = 4 << 20
HEALTH_PATHS = {b"/healthz", b"/readyz"}
_FULL = "too many connections: try again"


class Reading(Enum):
    """Phases of a request."""

    HEAD = "head"
    BODY = "body"
    BETWEEN = "between"  # the last one has come as a whole, the next one has not begun
    LINGER = "linger"  # what comes is thrown away


class _Refusal(Exception):
    """Ends the parsing of a request that is over a limit."""


class LimitedHttpProtocol(HttpToolsProtocol):
    """A connection to a caller who may be slow, greedy or deaf."""

    def __init__(self, *args: Any, connections: Connections, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._all = connections
        self._limits = connections.limits
        self._admission = Admission.FULL
        self._reading = Reading.HEAD
        self._since = self._looked_at = self.loop.time()  # _since: that this is being waited for
        self._overhead_bytes = 0  # of the data since the request began or a piece of its body came
        self._head_bytes = self._headers = 0
        self._body_bytes = 0
        self._linger_bytes = 0
        self._keep_alive = False  # what the caller wishes; granted once its body was read
        self._refusal: tuple[bytes, str] | None = None
        self._unsent_bytes: int | None = None  # when writing was paused; None: it is not
        self._write_paused_at = 0.0
        self._closing_since: float | None = None

    # What ``Connections`` asks

    @property
    def peer(self) -> str | None:
        return None if self.client is None else self.client[0]

    @property
    def waits_for_caller(self) -> bool:
        ending = self.is_lingering or self.transport.is_closing()
        return ending or (self._reading is not Reading.BODY and not self._answering)

    def overdue(self, now: float) -> Ended | None:
        waited_since, self._looked_at = self._looked_at, now
        if self._unsent_bytes is not None:  # nothing is written meanwhile, so what is gone was taken in
            taken = self._unsent_bytes - self.transport.get_write_buffer_size()
            allowed_s = self._limits.answer_s + taken / MIN_BYTES_PER_S
            return Ended.ANSWER if now - self._write_paused_at > allowed_s else None
        if self.transport.is_closing():
            if self._closing_since is None:
                self._closing_since = now
            return Ended.ANSWER if now - self._closing_since > LINGER_S else None
        if self.is_lingering:
            return Ended.UNREAD if now - self._since > LINGER_S else None
        if self._reading is Reading.BODY:
            if self.flow.read_paused or self.cycle.waiting_for_100_continue:  # the caller has to wait
                self._since += now - waited_since
            allowed_s = self._limits.body_s + LINGER_S + self._body_bytes / MIN_BYTES_PER_S
            return Ended.BODY if now - self._since > allowed_s else None
        if self._answering:
            return None
        if self._reading is Reading.HEAD:
            return Ended.HEAD if now - self._since > self._limits.head_s else None
        return Ended.IDLE if now - self._since > self._limits.idle_s else None

    def abort(self) -> None:
        self.transport.abort()

    # What the transport calls

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._wait_for(Reading.HEAD)
        self._admission = self._all.admit(self)
        if self._admission is Admission.REFUSED:  # nothing looks after it: it ends at once
            self._write_refusal(b"503 Service Unavailable", _FULL)
            self.transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        self._all.leave(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self.is_lingering:
            self._linger_bytes += len(data)
            if self._linger_bytes > LINGER_BYTES:
                self.abort()
            return
        self._overhead_bytes += len(data)
        super().data_received(data)
        if self._overhead_bytes > MAX_HEAD_BYTES and not self._is_ending:
            self._refuse(*_TOO_LARGE)

    def pause_writing(self) -> None:
        super().pause_writing()
        self._unsent_bytes = self.transport.get_write_buffer_size()
        self._write_paused_at = self.loop.time()

    def resume_writing(self) -> None:
        super().resume_writing()
        self._unsent_bytes = None

    # What the parser calls

    def on_message_begin(self) -> None:
        super().on_message_begin()
        self._head_bytes = self._headers = self._body_bytes = 0
        self._wait_for(Reading.HEAD)

    def on_url(self, url: bytes) -> None:
        self._count_head(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        self._headers += 1
        self._count_head(len(name) + len(value) + 4)
        if self._reading is Reading.HEAD:  # else it is a trailer: nobody reads those
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        self._overhead_bytes = 0
        path = self.url.partition(b"?")[0]
        if self._admission is Admission.HEALTH_ONLY and path not in HEALTH_PATHS:
            self._stop_parsing(b"503 Service Unavailable", _FULL)
        if len(self.pipeline) >= MAX_PIPELINED:
            self._stop_parsing(b"429 Too Many Requests", "too many requests at the same time")
        super().on_headers_complete()
        # An answer that comes before the body was read ends the connection, and says so.
        self._keep_alive = self.cycle.keep_alive and self._admission is Admission.FULL
        self.cycle.keep_alive = False
        self.cycle.transport = _AnswerTransport(self)  # type: ignore[assignment]
        self._wait_for(Reading.BODY)

    def on_body(self, body: bytes) -> None:
        self._overhead_bytes = 0
        self._body_bytes += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._overhead_bytes = 0
        super().on_message_complete()
        if not self.cycle.response_started:
            self.cycle.keep_alive = self._keep_alive
        self._wait_for(Reading.BETWEEN)

    def send_400_response(self, msg: str) -> None:
        """The parser has stopped."""
        self._refuse(*(self._refusal or (b"400 Bad Request", msg)))

    # What the answer's cycle and the server call

    def on_response_complete(self) -> None:
        if self.is_lingering:
            self.server_state.total_requests += 1
            return
        self._since = self.loop.time()
        super().on_response_complete()

    def shutdown(self) -> None:
        self._keep_alive = False
        super().shutdown()

    def end_after_answer(self) -> None:
        """The answer was written. What of the request is still on its way would make the system throw the
        answer away, if the connection were closed now."""
        if self._reading is Reading.BODY and self.cycle.response_complete:
            self._linger()
        else:
            self.transport.close()

    @property
    def is_lingering(self) -> bool:
        return self._reading is Reading.LINGER

    @property
    def _is_ending(self) -> bool:
        return self.is_lingering or self.transport.is_closing()

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and (not self.cycle.response_complete or bool(self.pipeline))

    def _wait_for(self, what: Reading) -> None:
        self._reading = what
        self._since = self._looked_at = self.loop.time()

    def _count_head(self, size: int) -> None:
        self._head_bytes += size
        if self._head_bytes > MAX_HEAD_BYTES or self._headers > MAX_HEADERS:
            self._stop_parsing(*_TOO_LARGE)

    def _stop_parsing(self, status: bytes, text: str) -> None:
        self._refusal = (status, text)
        raise _Refusal

    def _refuse(self, status: bytes, text: str) -> None:
        """Before the route is known there is no problem document to send. Nothing is sent where it would be
        taken for the answer to an earlier request, or for a part of it."""
        own = self._reading is Reading.BODY and not self.cycle.response_started and not self.pipeline
        if self._answering and not own:
            self.transport.close()
            return
        self._write_refusal(status, text)
        self._linger()

    def _write_refusal(self, status: bytes, text: str) -> None:
        self.transport.write(
            b"HTTP/1.1 %s\r\ncontent-type: text/plain\r\nconnection: close\r\ncontent-length: %d\r\n\r\n%s"
            % (status, len(text), text.encode())
        )

    def _linger(self) -> None:
        """Says that nothing more comes from here, and takes what comes for a moment."""
        if self._answering:  # whoever reads the body gets to know that no more of it comes
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        self._wait_for(Reading.LINGER)
        self._unset_keepalive_if_required()
        self.flow.resume_reading()
        self.transport.write_eof()


_TOO_LARGE = (b"431 Request Header Fields Too Large", "request header fields too large")


class _AnswerTransport:
    """The connection as the cycle of a request and its answer sees it."""

    def __init__(self, connection: LimitedHttpProtocol) -> None:
        self._connection = connection

    def write(self, data: bytes) -> None:
        if not self._connection.is_lingering:
            self._connection.transport.write(data)

    def is_closing(self) -> bool:
        return self._connection.is_lingering or self._connection.transport.is_closing()

    def close(self) -> None:
        self._connection.end_after_answer()
