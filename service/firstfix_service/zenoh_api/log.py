"""Around every zenoh query: the same id, span and line in the log that an HTTP request gets.

zenoh has no headers: two parameters of the selector stand for X-Request-Id and traceparent.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import structlog

from ..telemetry.request_scope import Requests

_log = structlog.get_logger(__name__)
TRANSPORT = "zenoh"
REQUEST_ID, TRACEPARENT = "request_id", "traceparent"
PARAMETERS = (REQUEST_ID, TRACEPARENT)  # of every query, besides the options
_METHOD = "GET"  # as zenoh calls a query


@contextmanager
def logged_query(requests: Requests, query: Any, arrived: float) -> Iterator[None]:
    """The scope of one query.

    Args:
        arrived: ``time.monotonic`` when it came.
    """
    given = dict(query.parameters)
    key = str(query.key_expr)
    with requests.scope(
        TRANSPORT,
        "zenoh localize",
        request_id=given.get(REQUEST_ID, ""),
        traceparent=given.get(TRACEPARENT),
        started=arrived,
    ) as scope:
        try:
            yield
        finally:
            _log.info("request", method=_METHOD, path=key, **scope.line)
            if scope.span is not None:
                scope.span.set_attribute("zenoh.key", key)
