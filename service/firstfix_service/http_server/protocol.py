"""HTTP/1.1 protocol: uvicorn's, with limits on size and time that uvicorn leaves to a proxy.

The limits are for the size of a request head, and for the time until the head, the body and the next request
arrive and the answer is read.
"""

from __future__ import annotations

import asyncio
import socket
from enum import Enum
from functools import partial
from typing import Any

import httptools
from starlette.requests import ClientDisconnect
from uvicorn.protocols.http.flow_control import HIGH_WATER_LIMIT
from uvicorn.protocols.http.httptools_impl import RequestResponseCycle

from ..limits.connections import CHECK_S, Connections, ConnectionUse, EndReason
from .exchange import Exchange
from .request_heads import TOO_LARGE, RequestHeads
from .streams import (
    ANSWER_WHOLE,
    ARRIVAL,
    DELAY_ANSWER,
    RECEIVE_INTO,
    RECEIVED,
    WHEN_GONE,
    AnswerDelay,
    Arrived,
    ReadingPace,
    Receiver,
    declared_bytes,
    limit_kernel_buffer,
)

HEALTH_PATHS = {b"/healthz", b"/readyz"}
_FULL = "too many connections: try again"


class Reading(Enum):
    """Phases of a request."""

    HEAD = "head"
    BODY = "body"
    BETWEEN = "between"  # the last request is complete, the next one has not begun
    LINGER = "linger"  # received data is dropped


class LimitedHttpProtocol(RequestHeads):
    """A connection whose caller may send too much, too slowly, or read nothing.

    Args:
        room: see ``Receiver``.

    Attributes:
        receiver: the protocol of its transport.
    """

    def __init__(self, *args: Any, connections: Connections, room: memoryview, **kwargs: Any) -> None:
        super().__init__(*args, limits=connections.limits, **kwargs)
        self.receiver = Receiver(self, room)
        self._all = connections
        self._use = ConnectionUse.ALL
        self._reading = Reading.HEAD
        self._since = self._checked_at = self.loop.time()  # _since: start of the current phase
        self._overhead_bytes = 0  # received since the request began, or since the last piece of its body
        self._body_bytes = 0
        self._linger_bytes, self._linger_limit = 0, self.limits.linger_bytes
        self._keep_alive = False  # the caller's wish; granted after its body was read
        self.pace = ReadingPace(self.limits)
        self._answer_bytes: int | None = None  # of the current one, of several; None: not begun; 0: a stream
        self.cycle: Exchange
        self._is_half_closed = False  # the caller sends no more, and may still read
        self._closing_since: float | None = None
        self._body: asyncio.Future[None] | None = None  # set when a body was received into its buffer
        self._delay = AnswerDelay()
        self._is_out_of_step = False  # the parser has missed a part of the body: it must not go on

    # Used by ``Connections``

    @property
    def peer(self) -> str | None:
        """Address of the other end, if known."""
        return None if self.client is None else self.client[0]

    @property
    def waits_for_caller(self) -> bool:
        """True if no work is done for the caller now."""
        ending = self._is_lingering or self.transport.is_closing()
        return (
            ending or self._delay.is_under_way or (self._reading is not Reading.BODY and not self._answering)
        )

    def overdue(self, now: float) -> EndReason | None:
        """The reason to end the connection now, if there is one."""
        limits = self.limits
        last_check, self._checked_at = self._checked_at, now
        if self.pace.is_paused:
            is_too_slow = self.pace.is_too_slow(now, self.transport.get_write_buffer_size())
            return EndReason.ANSWER if is_too_slow else None
        if self.transport.is_closing():
            if self._closing_since is None:
                self._closing_since = now
            return EndReason.ANSWER if now - self._closing_since > limits.linger_s else None
        if self._is_lingering:
            allowed_s = limits.linger_s + self._linger_bytes / limits.linger_bytes_per_s
            return EndReason.UNREAD if now - self._since > allowed_s else None
        if self._reading is Reading.BODY:
            if self.flow.read_paused or self.cycle.waiting_for_100_continue:
                # the caller must wait for this side
                self._since += now - last_check
            allowed_s = limits.body_timeout_s + limits.linger_s + self._body_bytes / limits.min_bytes_per_s
            return EndReason.BODY if now - self._since > allowed_s else None
        if self._answering:
            if self._is_half_closed:
                self._look_for_reset()
            return None
        if self._reading is Reading.HEAD:
            return EndReason.HEAD if now - self._since > limits.head_timeout_s else None
        return EndReason.IDLE if now - self._since > limits.keep_alive_s else None

    def abort(self) -> None:
        """End the connection at once."""
        self.transport.abort()

    # Called by the transport

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Ask for a place among the connections."""
        super().connection_made(transport)
        limit_kernel_buffer(transport.get_extra_info("socket"))
        self._wait_for(Reading.HEAD)
        self._use = self._all.admit(self)
        if self._use is ConnectionUse.NONE:  # ``Connections`` does not watch it: it ends at once
            self.write_refusal(b"503 Service Unavailable", _FULL)
            self.transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place back."""
        self._all.leave(self)
        super().connection_lost(exc)
        if self.cycle is not None:
            self.cycle.tell_gone()
        self._body_ended(ClientDisconnect())
        self._delay.end()

    def data_received(self, data: bytes) -> None:
        """Parse data, or drop it while the connection lingers."""
        if self._reading is Reading.LINGER or self._is_out_of_step:
            self._linger_bytes += len(data)
            if self._linger_bytes > self._linger_limit:
                self.abort()
            return
        self._overhead_bytes += len(data)
        try:
            self.parser.feed_data(data)
        except httptools.HttpParserError:
            self.logger.warning(_INVALID)
            self.send_400_response(_INVALID)
            return
        except httptools.HttpParserUpgrade:
            self._unsupported_upgrade_warning()
        if self._overhead_bytes > self.limits.max_head_bytes and not self._is_ending:
            self._refuse(*TOO_LARGE)

    def eof_received(self) -> bool:  # type: ignore[override]
        """Keep the connection open for the answers to complete requests.

        A caller that has closed both directions looks the same, and its work should end. An interim response
        tells them apart: the system of a caller that is gone refuses it, and any other caller skips it. A
        stream ends, because nothing can be sent in its middle.
        """
        is_stream = self._answer_bytes == 0
        if self._is_ending or is_stream or not self._answering or self._reading is Reading.BODY:
            return False
        if not self._is_half_closed:
            self._is_half_closed = True
            self._keep_alive = False
            if not self.cycle.response_started:
                self.cycle.keep_alive = False
            if self._answer_bytes is None and self.scope["http_version"] == "1.1":
                self.transport.write(_CONTINUE)
                self._look_after(_FIRST_LOOK_S)
        return True

    def pause_writing(self) -> None:
        """Start to measure how fast the caller reads."""
        super().pause_writing()
        self.pace.paused(self.loop.time())

    def resume_writing(self) -> None:
        """End the measurement: the caller has read enough."""
        super().resume_writing()
        self.pace.resumed(self.loop.time())

    # Called by the parser

    def on_message_begin(self) -> None:
        """Start the head of a request."""
        super().on_message_begin()
        self._body_bytes = 0
        self._wait_for(Reading.HEAD)

    def on_headers_complete(self) -> None:
        """Start the request, if the connection may make it."""
        self._overhead_bytes = 0
        if self._use is ConnectionUse.HEALTH_ONLY and self.url.partition(b"?")[0] not in HEALTH_PATHS:
            self.stop_parsing(b"503 Service Unavailable", _FULL)
        if len(self.pipeline) >= self.limits.max_pipelined:
            self.stop_parsing(b"429 Too Many Requests", "too many requests at the same time")
        scope = self.complete_scope()
        may_go_on = scope["http_version"] != "1.0" and self.parser.should_keep_alive()
        self._keep_alive = may_go_on and self._use is ConnectionUse.ALL
        before, self.cycle = self.cycle, Exchange(self, scope)
        extensions: dict[str, Any] = {
            RECEIVE_INTO: partial(self._receive_into, self.cycle),
            RECEIVED: self.cycle.received,
            ARRIVAL: self.cycle.arrival,
            WHEN_GONE: self.cycle.when_gone,
            DELAY_ANSWER: self._delay.wait,
            ANSWER_WHOLE: self.cycle.answer_whole,
        }
        scope["extensions"] = extensions
        self._wait_for(Reading.BODY)
        if before is None or before.response_complete:
            self._start(self.cycle)
        else:
            self.flow.pause_reading()
            self.pipeline.appendleft((self.cycle, self.app))

    def on_body(self, body: bytes) -> None:
        """Count a piece of the body."""
        self._overhead_bytes = 0
        self._body_bytes += len(body)
        cycle = self.cycle
        if not cycle.response_complete:
            cycle.body += body
            if len(cycle.body) > HIGH_WATER_LIMIT:
                self.flow.pause_reading()
            cycle.message_event.set()

    def on_message_complete(self) -> None:
        """End the request: the connection may be kept alive now."""
        self._overhead_bytes = 0
        cycle = self.cycle
        if not cycle.response_complete:
            cycle.more_body = False
            cycle.message_event.set()
            cycle.end_wait()
        if not cycle.response_started:
            cycle.keep_alive = self._keep_alive
        self._wait_for(Reading.BETWEEN)

    def _start(self, cycle: RequestResponseCycle) -> None:
        task = self.loop.create_task(cycle.run_asgi(self.app))
        task.add_done_callback(self.tasks.discard)
        self.tasks.add(task)

    def send_400_response(self, msg: str) -> None:
        """Answer a request that the parser refused."""
        self._refuse(*(self.refusal or (b"400 Bad Request", msg)))

    # Called by the cycle of the answer and by the server

    def on_response_complete(self) -> None:
        """Wait for the next request. uvicorn would set a timer for it: ``Connections`` looks at all."""
        self.server_state.total_requests += 1
        if self._reading is Reading.LINGER:
            return
        self._answer_bytes = None
        self._since = self.loop.time()
        if not self.transport.is_closing():
            if self.flow.read_paused:
                self.flow.resume_reading()
            if self.pipeline:
                self._start(self.pipeline.pop()[0])
        if self._is_half_closed and not self._answering:
            self.transport.close()

    def shutdown(self) -> None:
        """End the connection after the current answer."""
        self._keep_alive = False
        super().shutdown()

    def end_after_answer(self) -> None:
        """Close the connection after an answer.

        If the request is still arriving, the connection lingers first: the operating system would drop the
        answer if the connection were closed with unread data.
        """
        if self._reading is Reading.BODY and self.cycle.response_complete:
            rest_bytes = declared_bytes(self.headers) - self._body_bytes
            if self.limits.linger_bytes < rest_bytes <= self.limits.linger_body_bytes:
                self._linger_limit = rest_bytes
            self._linger()
        else:
            self.transport.close()

    def _body_ended(self, error: Exception | None) -> None:
        """End the reception of a body into a buffer, and parse what comes next.

        Args:
            error: why the body is not complete; None: it is.
        """
        body, self._body = self._body, None
        if body is None:
            return
        self.receiver.stop()
        if error is not None:
            self._is_out_of_step = True
            if not body.done():  # cancelled
                body.set_exception(error)
            return
        self.parser = httptools.HttpRequestParser(self)  # the old one still waits for the body
        self.parser.set_dangerous_leniencies(lenient_data_after_close=True)
        self.on_message_complete()
        if not body.done():
            body.set_result(None)

    async def _receive_into(self, cycle: Exchange, buffer: memoryview, arrived: Arrived) -> None:
        """Receive the body of a request, see ``ReceiveInto``."""
        if cycle.waiting_for_100_continue and not cycle.transport.is_closing():
            cycle.transport.write(_CONTINUE)
            cycle.waiting_for_100_continue = False
        parsed, cycle.body = cycle.body, bytearray()
        buffer[: len(parsed)] = parsed
        arrived(len(parsed))
        if not cycle.more_body:
            return
        if cycle.disconnected or cycle.response_complete:
            raise ClientDisconnect
        self._body = body = self.loop.create_future()
        self.flow.resume_reading()
        self.receiver.receive_body(buffer[len(parsed) :], partial(self._take, arrived), self._body_ended)
        try:
            await body
        finally:
            self._body_ended(ClientDisconnect())  # where nobody waits for it any more

    @property
    def drops_answers(self) -> bool:
        """True if nothing more is sent."""
        return self._reading is Reading.LINGER

    def answer_begins(self, size_bytes: int) -> None:
        """Begin to measure the caller of an answer, and whether it is a stream."""
        self._answer_bytes = size_bytes
        self.pace.begin(size_bytes, self.transport.get_write_buffer_size())

    def _look_after(self, wait_s: float) -> None:
        """Look again and again whether the caller is gone: a near one's system refuses data at once."""
        if wait_s < CHECK_S:  # then ``overdue`` is called as often
            self.loop.call_later(wait_s, self._look, wait_s)

    def _look(self, waited_s: float) -> None:
        if self._answering and not self.transport.is_closing():
            self._look_for_reset()
            self._look_after(2 * waited_s)

    def _look_for_reset(self) -> None:
        """End the connection if the caller's system has refused what was sent last: the caller is gone."""
        connection = self.transport.get_extra_info("socket")
        if connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self.abort()

    def _take(self, arrived: Arrived, size: int) -> None:
        self._body_bytes += size
        arrived(size)

    @property
    def _is_lingering(self) -> bool:
        """True if received data is dropped until the caller closes."""
        return self._reading is Reading.LINGER

    @property
    def _is_ending(self) -> bool:
        return self._is_lingering or self.transport.is_closing()

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and (not self.cycle.response_complete or bool(self.pipeline))

    def _wait_for(self, what: Reading) -> None:
        self._reading = what
        self._since = self._checked_at = self.loop.time()

    def _refuse(self, status: bytes, text: str) -> None:
        """Send a short refusal in plain text: there is no problem document before the route is known.

        Nothing is sent if the caller could take it for the answer to an earlier request, or a part of it.
        """
        own = self._reading is Reading.BODY and not self.cycle.response_started and not self.pipeline
        if self._answering and not own:
            self.transport.close()
            return
        self.write_refusal(status, text)
        self._linger()

    def _linger(self) -> None:
        """Close this side for writing, and drops received data for a while."""
        if self._answering:  # tells the reader of the body that no more of it will arrive
            self.cycle.disconnected = True
            self.cycle.message_event.set()
            self.cycle.tell_gone()
        self._body_ended(ClientDisconnect())
        self._wait_for(Reading.LINGER)
        self.flow.resume_reading()
        self.transport.write_eof()


_INVALID = "Invalid HTTP request received."
_FIRST_LOOK_S = 0.005
_CONTINUE = b"HTTP/1.1 100 Continue\r\n\r\n"
