"""Around every HTTP request: an id, one line in the log, the counters, and a document for what went wrong."""

from __future__ import annotations

import re
import time
import uuid

import structlog
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .metrics import Metrics
from .problems import problem_of

_log = structlog.get_logger(__name__)
_GOOD_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")
_QUIET = {"/healthz", "/readyz", "/metrics"}
_METHODS = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"}
MAX_PATH_CHARS = 300  # a stranger's path is no reason for a log line of any length
CLIENT_GONE = 499  # as nginx logs it; nobody is there to read it


class RequestLog:
    """ASGI middleware. The caller's X-Request-Id is kept if it is harmless, and always given back."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = dict(scope["headers"]).get(b"x-request-id", b"")
        request_id = given if _GOOD_ID.fullmatch(given) else uuid.uuid4().hex.encode()
        status = 0
        start = time.perf_counter()

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message = {**message, "headers": [*message["headers"], (b"x-request-id", request_id)]}
            await send(message)

        with structlog.contextvars.bound_contextvars(request_id=request_id.decode()):
            try:
                await self._app(scope, receive, send_with_id)
            except ClientDisconnect:
                status = CLIENT_GONE
            except Exception as error:
                _log.exception("unexpected error")
                if status:  # the answer was under way: nothing to do but to break it off
                    raise
                await problem_of(error).response()(scope, receive, send_with_id)
            finally:
                self._record(scope, status, time.perf_counter() - start)

    def _record(self, scope: Scope, status: int, seconds: float) -> None:
        route = getattr(scope.get("route"), "path", "unknown")
        method = scope["method"] if scope["method"] in _METHODS else "other"
        self._metrics.http_requests.labels(method, route, str(status)).inc()
        self._metrics.http_seconds.labels(route).observe(seconds)
        log = _log.debug if route in _QUIET else _log.info
        caller = scope.get("state", {}).get("caller")
        log(
            "request",
            method=method,
            path=scope["path"][:MAX_PATH_CHARS],
            status=status,
            ms=round(seconds * 1e3, 2),
            caller=None if caller is None else caller.name,
        )
