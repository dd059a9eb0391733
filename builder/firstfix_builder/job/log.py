"""Log of the build process: plain text, or JSON in the form of the service's log, with the build's ids."""

from __future__ import annotations

import json
import logging
from datetime import datetime, timezone

from ..execution.build_trace import current_build

_PLAIN = "%(asctime)s %(levelname)s %(name)s %(message)s"


def set_up_build_log(build_id: str, *, level: str = "info", as_json: bool = False) -> None:
    """Sets up the log of this process. Called by the worker's ``main``, never by an import."""
    handler = logging.StreamHandler()
    handler.setFormatter(_JsonLines(build_id) if as_json else logging.Formatter(_PLAIN))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


class _JsonLines(logging.Formatter):
    def __init__(self, build_id: str) -> None:
        super().__init__()
        self._build_id = build_id

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "event": record.getMessage(),
            "level": record.levelname.lower(),
            "logger": record.name,
            "timestamp": datetime.fromtimestamp(record.created, timezone.utc).isoformat(),
            "build_id": self._build_id,
        }
        build = current_build()
        if build is not None:
            line["stage"] = build.stage
            if build.trace is not None:
                line |= {"trace_id": build.trace.trace_id, "span_id": build.trace.span_id}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line)
