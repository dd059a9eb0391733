"""Set-up of logs: structlog for this service, logging for its libraries, in one format on one stream."""

from __future__ import annotations

import io
import json
import logging
import sys
from collections.abc import Callable, MutableMapping
from typing import Any, TextIO

import structlog

from firstfix.telemetry.library_logs import silence_libraries

from ..settings import Settings
from .log_lines import LAST_LINES_WITHIN_S, LogLines, LogStream, complete, hiding_secrets

__all__ = ["LAST_LINES_WITHIN_S", "drain_log", "set_up_logging"]


def set_up_logging(settings: Settings) -> None:
    """Set up the logs of this process. Called by ``serve``, never by an import."""
    level, as_json = getattr(logging, settings.log_level.upper()), settings.log_json
    secret_urls = [url.get_secret_value() for url in settings.webhook_urls]
    render = hiding_secrets(_json if as_json else _plain(), secret_urls)
    handler = logging.StreamHandler(_stream(sys.stderr))
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=[complete],
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                lambda logger, name, line: render(line),
            ],
        )
    )
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level)
    silence_libraries()
    # Straight to the stream: the way through logging takes as long again, for each request.
    structlog.configure(
        processors=[complete],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=lambda name="": LogLines(name, handler, render, level),
        cache_logger_on_first_use=True,
    )


def _plain() -> Callable[[MutableMapping[str, Any]], str]:
    """A renderer for people, whose tracebacks leave out variables: these could be secrets of requests."""
    renderer = structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)
    return lambda line: renderer(None, "", line)


def _json(line: MutableMapping[str, Any]) -> str:
    if "exc_info" in line:
        line = structlog.processors.format_exc_info(None, "", line)
    return _ENCODER.encode(line)


_ENCODER = json.JSONEncoder(default=repr, check_circular=False)  # made once: that takes as long as a line


def drain_log(within_s: float) -> None:
    """Wait until the lines of the log are written, or for ``within_s``: before the process ends at once."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, logging.StreamHandler) and isinstance(handler.stream, LogStream):
            handler.stream.drain(within_s)


def _stream(stream: TextIO) -> TextIO | LogStream:
    try:
        return LogStream(stream.fileno())
    except io.UnsupportedOperation:  # it is in memory, where no write waits
        return stream
