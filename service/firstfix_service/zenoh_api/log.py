"""Request scope of zenoh queries: the same id, span and log line as for an HTTP request.

zenoh has no headers: two selector parameters replace X-Request-Id and traceparent.
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
PARAMETERS = (REQUEST_ID, TRACEPARENT)  # of every query, beside the options
_METHOD = "GET"  # zenoh's word for a query


@contextmanager
def logged_query(requests: Requests, query: Any, arrived: float) -> Iterator[None]:
    """Opens the scope of one query, and logs the query when it ends.

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
