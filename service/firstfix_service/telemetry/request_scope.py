"""Scope of one request of either transport: its ids, its span, and its line on the way into the log.

Any task or thread that runs in the request's context can add fields with ``note``.
"""

from __future__ import annotations

import atexit
import logging
import os
import re
import threading
import time
import uuid
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import structlog

from firstfix.ids import check_robot_name
from firstfix.telemetry.redact import redactor
from firstfix.telemetry.trace_context import TraceContext

from .tracing import Tracing, started_ns

if TYPE_CHECKING:
    from opentelemetry.trace import Span

MAX_BYTES = 4 << 20  # of lines that wait for the reader
MAX_WRITE_BYTES = 64 << 10  # lines that are written together
GATHER_S = 0.005  # in which lines are gathered for one write
LAST_LINES_WITHIN_S = 2.0  # of the process
_GOOD_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass
class RequestScope:
    """One request.

    Attributes:
        started: time of arrival (``time.monotonic``).
        trace: trace context of its span; without tracing, the context that the caller sent.
        span: None without tracing.
        status: HTTP status of the answer; 0 if there was no answer.
        fields: fields of its log line; its span gets them too, as ``firstfix.*``.
    """

    request_id: str
    transport: str
    started: float
    trace: TraceContext | None
    span: Span | None
    status: int = 0
    fields: dict[str, Any] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Seconds since the request arrived."""
        return time.monotonic() - self.started

    @property
    def line(self) -> dict[str, Any]:
        """Fields of the log line, besides ids, method and path."""
        return {"status": self.status, "ms": round(self.seconds * 1e3, 2), **self.fields}


_current: ContextVar[RequestScope | None] = ContextVar("firstfix_request", default=None)


def current_request() -> RequestScope | None:
    """The request that is being served, if any."""
    return _current.get()


def current_caller() -> str:
    """The name of the caller of the request that is being served; empty if there is none."""
    scope = _current.get()
    return "" if scope is None else str(scope.fields.get("caller", ""))


def note(**fields: Any) -> None:
    """Add fields to the log line and the span of the request that is being served, if any."""
    scope = _current.get()
    if scope is not None:
        scope.fields.update(fields)


def note_robot(name: str | None) -> None:
    """Note the name that the robot of this request goes by, if it was given.

    Raises:
        InvalidOption: it is malformed.
    """
    if name:
        note(robot=check_robot_name(name))


def with_traceparent(record: Mapping[str, Any]) -> dict[str, Any]:
    """The record with the current trace context, so that later work on it continues the trace."""
    scope = _current.get()
    if scope is None or scope.trace is None:
        return dict(record)
    return {**record, "traceparent": scope.trace.traceparent}


class Requests:
    """Factory of the request scopes of one app.

    Attributes:
        tracing: set when the app starts; None: there are no spans.
    """

    def __init__(self) -> None:
        self.tracing: Tracing | None = None

    @contextmanager
    def scope(
        self, transport: str, name: str | None, *, request_id: str, traceparent: str | None, started: float
    ) -> Iterator[RequestScope]:
        """Open the scope of a request.

        Args:
            name: of the span; None: the request gets no span.
            request_id: sent by the caller; if its form is not allowed, a new one is made.
            traceparent: sent by the caller, if any.
            started: time of arrival (``time.monotonic``).
        """
        caller = TraceContext.parse(traceparent)
        span: Span | None = None
        with ExitStack() as stack:
            if self.tracing is not None and name is not None:
                span = stack.enter_context(self.tracing.request(name, caller, started_ns(started)))
            own = None if span is None else TraceContext.of(span)
            chosen = request_id if _GOOD_ID.fullmatch(request_id) else uuid.uuid4().hex
            scope = RequestScope(chosen, transport, started, own or caller, span)
            stack.enter_context(structlog.contextvars.bound_contextvars(**_ids(scope)))
            token = _current.set(scope)
            try:
                yield scope
            finally:
                _current.reset(token)
                self._finish(scope)

    def _finish(self, scope: RequestScope) -> None:
        if self.tracing is None or scope.span is None:
            return
        about = {**scope.fields, **_transport_ids(scope), "status": scope.status}
        scope.span.set_attributes({f"firstfix.{key}": value for key, value in about.items()})
        if scope.status >= 500:
            self.tracing.fail(scope.span, str(scope.fields.get("code", scope.status)))


def _transport_ids(scope: RequestScope) -> dict[str, str]:
    return {"request_id": scope.request_id, "transport": scope.transport}


def _ids(scope: RequestScope) -> dict[str, str]:
    """Fields of every log line that is written during the request."""
    ids = _transport_ids(scope)
    if scope.trace is not None:
        ids |= {"trace_id": scope.trace.trace_id, "span_id": scope.trace.span_id}
    return ids


class LogLines:
    """Writes finished lines to the stream of a handler. Like the handler, it never fails."""

    def __init__(self, name: str, handler: logging.StreamHandler[Any]) -> None:
        self.name = name
        self._handler = handler

    def info(self, line: str) -> None:
        """Write a line, at any level."""
        assert self._handler.lock is not None
        with self._handler.lock, suppress(OSError, ValueError):  # a full disk, or a closed stream
            self._handler.stream.write(line + "\n")
            self._handler.stream.flush()

    debug = warning = error = critical = info


def hiding_secrets(urls: Iterable[str]) -> structlog.typing.Processor:
    """The last log processor, which hides keys, tokens and passwords in the finished line.

    Args:
        urls: whose paths and queries are secrets.
    """
    redact = redactor(urls=urls)

    def hide(logger: Any, name: str, line: Any) -> str:
        return redact(str(line))

    return hide


class LogStream:
    """A text stream that writes to a file descriptor in a thread of its own. Thread-safe.

    Who reads the log may stop: a frozen collector, a full pipe, a hung disk. A write would then wait for it,
    and with it the event loop and all requests. So lines go through a bounded queue. Lines for which there is
    no room are lost and counted.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0  # with those that are being written
        self._lost = 0
        self._changed = threading.Condition()
        threading.Thread(target=self._run, name="log", daemon=True).start()
        atexit.register(self.drain, LAST_LINES_WITHIN_S)

    def write(self, text: str) -> int:
        """Queues whole lines, or drops them if too many wait. Never blocks."""
        line = text.encode("utf-8", "backslashreplace")
        with self._changed:
            if self._waiting_bytes + len(line) > MAX_BYTES:
                self._lost += 1
            else:
                self._waiting.append(line)
                self._waiting_bytes += len(line)
                self._changed.notify_all()
        return len(text)

    def flush(self) -> None:
        """Do nothing: the thread writes as fast as the reader takes it."""

    def drain(self, within_s: float) -> None:
        """Wait until all lines are written, or for ``within_s``."""
        with self._changed:
            self._changed.wait_for(lambda: not self._waiting_bytes, within_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)
            time.sleep(GATHER_S)
            lines, size = self._take()
            self._write(lines)
            with self._changed:
                self._waiting_bytes -= size
                self._changed.notify_all()

    def _take(self) -> tuple[bytes, int]:
        """The next lines, with a line about lost ones, and the bytes that were counted for them."""
        with self._changed:
            lines = [self._waiting.popleft()]
            size = len(lines[0])
            while self._waiting and size + len(self._waiting[0]) <= MAX_WRITE_BYTES:
                lines.append(self._waiting.popleft())
                size += len(lines[-1])
            lost, self._lost = (self._lost, 0) if not self._waiting else (0, self._lost)
        if lost:
            lines.append(b'{"event": "log lines were lost: its reader was too slow", "lines": %d}\n' % lost)
        return b"".join(lines), size

    def _write(self, lines: bytes) -> None:
        rest = memoryview(lines)
        with suppress(OSError):  # a full disk, or a reader that has gone
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
