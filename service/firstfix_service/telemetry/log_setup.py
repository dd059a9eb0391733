"""Set-up of logs: structlog for this service, logging for its libraries, in one format on one stream."""

from __future__ import annotations

import io
import logging
import sys
from contextlib import suppress
from typing import Any, TextIO

import structlog

from firstfix.telemetry.redact import redactor

from .log_stream import LAST_LINES_WITHIN_S, LogStream

__all__ = ["LAST_LINES_WITHIN_S", "drain_log", "hiding_secrets", "set_up_logging"]


def set_up_logging(level: str, *, as_json: bool) -> None:
    """Sets up the logs of this process. Called by ``serve``, never by an import."""
    shared: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.StackInfoRenderer(),
    ]
    last: list[structlog.typing.Processor] = (
        [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
        if as_json
        # tracebacks without variables, which could contain the secrets of requests
        else [
            structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback),
        ]
    )
    last.append(hiding_secrets())
    handler = logging.StreamHandler(_stream(sys.stderr))
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last],
        )
    )
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level.upper())
    # Straight to the stream: the way through logging takes as long again, for each request.
    structlog.configure(
        processors=[*shared, *last],
        wrapper_class=structlog.make_filtering_bound_logger(getattr(logging, level.upper())),
        logger_factory=lambda name="": _Lines(name, handler),
        cache_logger_on_first_use=True,
    )


def drain_log(within_s: float) -> None:
    """Waits until the lines of the log are written, or for ``within_s``: before the process ends at once."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, logging.StreamHandler) and isinstance(handler.stream, LogStream):
            handler.stream.drain(within_s)


def _stream(stream: TextIO) -> TextIO | LogStream:
    try:
        return LogStream(stream.fileno())
    except io.UnsupportedOperation:  # it is in memory, where no write waits
        return stream


class _Lines:
    """Writes finished lines to the stream of a handler. Like the handler, it never fails."""

    def __init__(self, name: str, handler: logging.StreamHandler[Any]) -> None:
        self.name = name
        self._handler = handler

    def info(self, line: str) -> None:
        assert self._handler.lock is not None
        with self._handler.lock, suppress(OSError, ValueError):  # a full disk, or a closed stream
            self._handler.stream.write(line + "\n")
            self._handler.stream.flush()

    debug = warning = error = critical = info


def hiding_secrets() -> structlog.typing.Processor:
    """Returns the last log processor, which hides keys, tokens and passwords in the finished line."""
    redact = redactor()

    def hide(logger: Any, name: str, line: Any) -> str:
        return redact(str(line))

    return hide
