"""The log of a service in this process, as JSON lines."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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


@contextmanager
def json_log() -> Iterator[JsonLog]:
    """Sets up JSON logs like ``serve``, until the block ends. The caller restores ``logging`` itself."""
    kept = JsonLog()
    with patch.object(sys, "stderr", kept.stream):
        set_up_logging(Settings(store="memory://"))
    with ExitStack() as stack:
        # loggers that were used before keep their old format
        for module in [m for name, m in sys.modules.items() if name.startswith("firstfix_service.")]:
            if hasattr(module, "_log"):
                stack.enter_context(patch.object(module, "_log", structlog.get_logger(module.__name__)))
        yield kept
