"""Lines of the log: what each of them says, and their way to a stream that may stand still."""

from __future__ import annotations

import atexit
import logging
import os
import threading
import time
from collections.abc import Callable, Iterable, MutableMapping
from contextlib import suppress
from datetime import datetime, timezone
from functools import partial
from queue import SimpleQueue
from typing import Any

import structlog

from firstfix.telemetry.redact import redactor

from .request_scope import RequestScope, current_request

MAX_BYTES = 4 << 20  # of lines that wait for the reader
UNRENDERED_BYTES = 1 << 10  # that a line counts for before it is rendered, besides its texts
MAX_WRITE_BYTES = 64 << 10  # lines that are written together
GATHER_S = 0.2  # in which lines are gathered for one write: each wakes a thread, beside the event loop
LAST_LINES_WITHIN_S = 2.0  # of the process
_with_stack = structlog.processors.StackInfoRenderer()
_LEVELS = {"warn": "warning", "exception": "error"}


def complete(logger: Any, name: str, line: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """The log processor that adds to each line who logs it and when, and the ids of the request.

    structlog has a processor for each of these. One for all takes a third of their time.
    """
    record = line.get("_record")  # of a library
    logger_name = logger.name if record is None else record.name
    _complete(line, current_request(), _LEVELS.get(name, name), logger_name, time.time())
    return _with_stack(logger, name, line) if "stack_info" in line else line


def _complete(
    line: MutableMapping[str, Any], scope: RequestScope | None, level: str, logger_name: str, time_s: float
) -> None:
    if scope is not None:
        line.setdefault("request_id", scope.request_id)
        line.setdefault("transport", scope.transport)
        if scope.trace is not None:
            line.setdefault("trace_id", scope.trace.trace_id)
            line.setdefault("span_id", scope.trace.span_id)
    line["level"] = level
    line["logger"] = logger_name
    line["timestamp"] = datetime.fromtimestamp(time_s, timezone.utc).isoformat().replace("+00:00", "Z")


class LogLines:
    """Writes complete lines to the stream of a handler. Like the handler, it never fails.

    Attributes:
        name: of who logs.
        level: least level of what is written, as ``logging`` counts them.
    """

    def __init__(
        self,
        name: str,
        handler: logging.StreamHandler[Any],
        render: Callable[[MutableMapping[str, Any]], str],
        level: int,
    ) -> None:
        self.name = name
        self.level = level
        self._handler = handler
        self._render = render

    def info(self, **line: Any) -> None:
        """Write a line, at any level."""
        stream = self._handler.stream
        if isinstance(stream, LogStream) and "exc_info" not in line:  # a traceback holds what it names
            texts = sum(len(part) for part in line.values() if isinstance(part, str))
            stream.queue(partial(self._render, line), UNRENDERED_BYTES + texts)
            return
        text = self._render(line) + "\n"
        assert self._handler.lock is not None
        with self._handler.lock, suppress(OSError, ValueError):  # a full disk, or a closed stream
            stream.write(text)
            stream.flush()

    debug = warning = error = critical = info

    def write_made(self, make: Callable[[], MutableMapping[str, Any]], texts: int) -> None:
        """Write a line, at any level, that is made only where it is rendered.

        Args:
            texts: characters of what a caller chose in it.
        """
        stream = self._handler.stream
        if isinstance(stream, LogStream):
            stream.queue(lambda: self._render(make()), UNRENDERED_BYTES + texts)
        else:
            self.info(**make())


class RequestLines:
    """Writes the lines of requests as structlog would, whose layers take longer than all else of them.

    Args:
        name: of who logs.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        lines = structlog.get_config()["logger_factory"](name)
        self._lines = lines if isinstance(lines, LogLines) else None  # None: not set up by this service
        self._log = structlog.get_logger(name)

    def write(self, scope: RequestScope, level: int, method: str, path: str, seconds: float) -> None:
        """Write a line.

        Args:
            level: of the line, as ``logging`` counts them.
            method, path: of the request.
            seconds: that it took.
        """
        if self._lines is None:
            self._log.log(level, "request", method=method, path=path, **scope.line(seconds))
        elif level >= self._lines.level:
            make = partial(self._line, scope, level, method, path, seconds, time.time())
            self._lines.write_made(make, len(method) + len(path))

    def _line(
        self, scope: RequestScope, level: int, method: str, path: str, seconds: float, time_s: float
    ) -> MutableMapping[str, Any]:
        line = {"method": method, "path": path, **scope.line(seconds), "event": "request"}
        _complete(line, scope, logging.getLevelName(level).lower(), self._name, time_s)
        return line


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
        self._waiting: SimpleQueue[tuple[bytes | Callable[[], str], int]] = SimpleQueue()
        self._waiting_bytes = 0  # with those that are being written
        self._lost = 0
        self._lock = threading.Lock()
        self._written = threading.Condition(self._lock)
        threading.Thread(target=self._run, name="log", daemon=True).start()
        atexit.register(self.drain, LAST_LINES_WITHIN_S)

    def write(self, text: str) -> int:
        """Queues whole lines, or drops them if too many wait. Never blocks."""
        line = _encoded(text)
        self.queue(line, len(line))
        return len(text)

    def queue(self, line: bytes | Callable[[], str], size: int) -> None:
        """Queue a line, or what renders it, or drop it if too many wait. Never blocks.

        Args:
            size: bytes that it counts for until it is written.
        """
        with self._lock:
            if self._waiting_bytes + size > MAX_BYTES:
                self._lost += 1
            else:
                self._waiting_bytes += size
                self._waiting.put((line, size))

    def flush(self) -> None:
        """Do nothing: the thread writes as fast as the reader takes it."""

    def drain(self, within_s: float) -> None:
        """Wait until all lines are written, or for ``within_s``."""
        with self._written:
            self._written.wait_for(lambda: not self._waiting_bytes, within_s)

    def _run(self) -> None:
        while True:
            first: tuple[bytes | Callable[[], str], int] | None = self._waiting.get()
            time.sleep(GATHER_S)
            while first is not None:
                lines, size = self._with_more(*first)
                self._write(lines)
                with self._written:
                    self._waiting_bytes -= size
                    self._written.notify_all()
                first = None if self._waiting.empty() else self._waiting.get()

    def _with_more(self, line: bytes | Callable[[], str], size: int) -> tuple[bytes, int]:
        """A line and the next ones, with one about lost lines, and the bytes that were counted for them."""
        lines: list[bytes] = []
        lost = 0
        while True:
            lines.append(line if isinstance(line, bytes) else _rendered(line))
            if size > MAX_WRITE_BYTES or self._waiting.empty():
                break
            line, more = self._waiting.get()
            size += more
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


def _rendered(line: Callable[[], str]) -> bytes:
    try:
        return _encoded(line() + "\n")
    except Exception as error:  # the thread goes on
        return (
            b'{"event": "a log line could not be rendered", "error": "%s"}\n' % type(error).__name__.encode()
        )


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")
