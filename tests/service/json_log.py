"""The log of a service in this process, as JSON lines."""

from __future__ import annotations

import io
import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import structlog

from firstfix_service.settings import Settings
from firstfix_service.telemetry.log_setup import set_up_logging


class JsonLog:
    """Reads log lines written as JSON."""

    def __init__(self) -> None:
        self.stream = io.StringIO()

    @property
    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.stream.getvalue().splitlines()]

    def of(self, **fields: Any) -> list[dict[str, Any]]:
        return [line for line in self.lines if fields.items() <= line.items()]


def renew_loggers() -> None:
    """Give each module of the service a logger that was not used yet: a used one keeps its set-up."""
    for name, module in list(sys.modules.items()):
        logger = getattr(module, "_log", None) if name.startswith("firstfix_service.") else None
        if logger is not None and not isinstance(logger, logging.Logger):
            vars(module)["_log"] = structlog.get_logger(name)


@contextmanager
def logging_restored() -> Iterator[None]:
    """Undoes what is set up for logs in the block."""
    root = logging.getLogger()
    handlers = root.handlers[:]
    levels = {name: logging.getLogger(name).level for name in (None, "httpx", "httpcore")}
    try:
        yield
    finally:
        root.handlers = handlers
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
        structlog.reset_defaults()
        renew_loggers()


@contextmanager
def json_log() -> Iterator[JsonLog]:
    """Sets up JSON logs like ``serve``, until the block ends."""
    kept = JsonLog()
    with logging_restored():
        with patch.object(sys, "stderr", kept.stream):
            set_up_logging(Settings(store="memory://"))
        renew_loggers()
        yield kept
