"""Set-up of logs: structlog for this service, logging for its libraries, in one format."""

from __future__ import annotations

import logging
import sys
from typing import Any

import structlog

from firstfix.redact import redactor


def set_up_logging(level: str, *, as_json: bool) -> None:
    """Sets up the logs of this process. Called by ``serve``, never by an import."""
    shared: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.StackInfoRenderer(),
    ]
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        wrapper_class=structlog.stdlib.BoundLogger,
        logger_factory=structlog.stdlib.LoggerFactory(),
        cache_logger_on_first_use=True,
    )
    last: list[structlog.typing.Processor] = (
        [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
        if as_json
        # tracebacks without variables, which could contain the secrets of requests
        else [
            structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback),
        ]
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last, hiding_secrets()],
        )
    )
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level.upper())


def hiding_secrets() -> structlog.typing.Processor:
    """Returns the last log processor, which hides keys, tokens and passwords in the finished line."""
    redact = redactor()

    def hide(logger: Any, name: str, line: Any) -> str:
        return redact(str(line))

    return hide
