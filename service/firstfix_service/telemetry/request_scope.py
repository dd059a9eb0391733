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
from collections.abc import Callable, Iterable, Mapping, MutableMapping
from contextlib import AbstractContextManager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import partial
from queue import SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, Any

import structlog

from firstfix.ids import check_robot_name
from firstfix.telemetry.redact import redactor
from firstfix.telemetry.trace_context import TraceContext

from .tracing import Tracing, started_ns

if TYPE_CHECKING:
    from opentelemetry.trace import Span

MAX_BYTES = 4 << 20  # of lines that wait for the reader
UNRENDERED_BYTES = 1 << 10  # that a line counts for before it is rendered
MAX_WRITE_BYTES = 64 << 10  # lines that are written together
GATHER_S = 0.2  # in which lines are gathered for one write: each wakes a thread, beside the event loop
LAST_LINES_WITHIN_S = 2.0  # of the process
_with_stack = structlog.processors.StackInfoRenderer()
_LEVELS = {"warn": "warning", "exception": "error"}
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

    def line(self, seconds: float) -> dict[str, Any]:
        """Fields of the log line after so many seconds, besides ids, method and path."""
        return {"status": self.status, "ms": round(seconds * 1e3, 2), **self.fields}


_current: ContextVar[RequestScope | None] = ContextVar("firstfix_request", default=None)


current_request = _current.get  # the request that is being served, if any


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

    def scope(
        self, transport: str, name: str | None, *, request_id: str, traceparent: str | None, started: float
    ) -> OpenRequest:
        """The scope of a request, which a ``with`` statement opens and ends.

        Args:
            name: of the span; None: the request gets no span.
            request_id: sent by the caller; if its form is not allowed, a new one is made.
            traceparent: sent by the caller, if any.
            started: time of arrival (``time.monotonic``).
        """
        caller = TraceContext.parse(traceparent) if traceparent else None
        span = None
        if self.tracing is not None and name is not None:
            span = self.tracing.request(name, caller, started_ns(started))
        chosen = request_id if request_id and _GOOD_ID.fullmatch(request_id) else os.urandom(16).hex()
        return OpenRequest(RequestScope(chosen, transport, started, caller, None), span, self.finish)

    def finish(self, scope: RequestScope) -> None:
        """Tell the span of a request how it ended."""
        if self.tracing is None or scope.span is None:
            return
        ids = {"request_id": scope.request_id, "transport": scope.transport}
        about = {**scope.fields, **ids, "status": scope.status}
        scope.span.set_attributes({f"firstfix.{key}": value for key, value in about.items()})
        if scope.status >= 500:
            self.tracing.fail(scope.span, str(scope.fields.get("code", scope.status)))


class OpenRequest:
    """The scope of one request while it is served."""

    def __init__(
        self,
        scope: RequestScope,
        span: AbstractContextManager[Span] | None,
        finish: Callable[[RequestScope], None],
    ) -> None:
        self._scope, self._span, self._finish = scope, span, finish

    def __enter__(self) -> RequestScope:
        if self._span is not None:
            self._scope.span = self._span.__enter__()
            self._scope.trace = TraceContext.of(self._scope.span)
        self._token = _current.set(self._scope)
        return self._scope

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _current.reset(self._token)
        if self._span is None:
            return
        try:
            self._finish(self._scope)
        finally:
            self._span.__exit__(kind, error, trace)


def complete(logger: Any, name: str, line: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """The log processor that adds to each line who logs it and when, and the ids of the request.

    structlog has a processor for each of these. One for all takes a third of their time.
    """
    scope = _current.get()
    if scope is not None:
        line.setdefault("request_id", scope.request_id)
        line.setdefault("transport", scope.transport)
        if scope.trace is not None:
            line.setdefault("trace_id", scope.trace.trace_id)
            line.setdefault("span_id", scope.trace.span_id)
    record = line.get("_record")  # of a library
    line["level"] = _LEVELS.get(name, name)
    line["logger"] = logger.name if record is None else record.name
    line["timestamp"] = datetime.now(timezone.utc).isoformat().replace("+00:00", "Z")
    return _with_stack(logger, name, line) if "stack_info" in line else line


class LogLines:
    """Writes complete lines to the stream of a handler. Like the handler, it never fails."""

    def __init__(
        self,
        name: str,
        handler: logging.StreamHandler[Any],
        render: Callable[[MutableMapping[str, Any]], str],
    ) -> None:
        self.name = name
        self._handler = handler
        self._render = render

    def info(self, **line: Any) -> None:
        """Write a line, at any level."""
        stream = self._handler.stream
        if isinstance(stream, LogStream) and "exc_info" not in line:  # a traceback holds what it names
            stream.write_later(self._render, line)
            return
        text = self._render(line) + "\n"
        assert self._handler.lock is not None
        with self._handler.lock, suppress(OSError, ValueError):  # a full disk, or a closed stream
            stream.write(text)
            stream.flush()

    debug = warning = error = critical = info


def hiding_secrets(
    render: Callable[[MutableMapping[str, Any]], str], urls: Iterable[str]
) -> Callable[[MutableMapping[str, Any]], str]:
    """A renderer of lines that hides keys, tokens and passwords in them.

    Args:
        urls: whose paths and queries are secrets.
    """
    redact = redactor(urls=urls)
    return lambda line: redact(render(line))


class LogStream:
    """A text stream that writes to a file descriptor in a thread of its own. Thread-safe.

    The thread also renders lines, several together: code that has just run takes a third of the time.

    Who reads the log may stop: a frozen collector, a full pipe, a hung disk. A write would then wait for it,
    and with it the event loop and all requests. So lines go through a bounded queue. Lines for which there is
    no room are lost and counted.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: SimpleQueue[bytes | partial[str]] = SimpleQueue()
        self._waiting_bytes = 0  # with those that are being written
        self._lost = 0
        self._lock = threading.Lock()
        self._written = threading.Condition(self._lock)
        threading.Thread(target=self._run, name="log", daemon=True).start()
        atexit.register(self.drain, LAST_LINES_WITHIN_S)

    def write(self, text: str) -> int:
        """Queues whole lines, or drops them if too many wait. Never blocks."""
        line = _encoded(text)
        self._put(line, len(line))
        return len(text)

    def write_later(self, render: Callable[[MutableMapping[str, Any]], str], line: dict[str, Any]) -> None:
        """Queue a line that is still to be rendered, or drop it if too many wait. Never blocks."""
        self._put(partial(render, line), UNRENDERED_BYTES)

    def _put(self, line: bytes | partial[str], size: int) -> None:
        with self._lock:
            if self._waiting_bytes + size > MAX_BYTES:
                self._lost += 1
            else:
                self._waiting_bytes += size
                self._waiting.put(line)

    def flush(self) -> None:
        """Do nothing: the thread writes as fast as the reader takes it."""

    def drain(self, within_s: float) -> None:
        """Wait until all lines are written, or for ``within_s``."""
        with self._written:
            self._written.wait_for(lambda: not self._waiting_bytes, within_s)

    def _run(self) -> None:
        while True:
            line: bytes | partial[str] | None = self._waiting.get()
            time.sleep(GATHER_S)
            while line is not None:
                lines, size = self._with_more(line)
                self._write(lines)
                with self._written:
                    self._waiting_bytes -= size
                    self._written.notify_all()
                line = None if self._waiting.empty() else self._waiting.get()

    def _with_more(self, line: bytes | partial[str]) -> tuple[bytes, int]:
        """A line and the next ones, with one about lost lines, and the bytes that were counted for them."""
        lines: list[bytes] = []
        size = lost = 0
        while True:
            size += len(line) if isinstance(line, bytes) else UNRENDERED_BYTES
            lines.append(line if isinstance(line, bytes) else _rendered(line))
            if size > MAX_WRITE_BYTES or self._waiting.empty():
                break
            line = self._waiting.get()
        with self._lock:
            if self._waiting.empty():
                lost, self._lost = self._lost, 0
        if lost:
            lines.append(b'{"event": "log lines were lost: its reader was too slow", "lines": %d}\n' % lost)
        return b"".join(lines), size

    def _write(self, lines: bytes) -> None:
        rest = memoryview(lines)
        with suppress(OSError):  # a full disk, or a reader that has gone
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]


def _rendered(line: partial[str]) -> bytes:
    try:
        return _encoded(line() + "\n")
    except Exception as error:  # the thread goes on
        return (
            b'{"event": "a log line could not be rendered", "error": "%s"}\n' % type(error).__name__.encode()
        )


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")
