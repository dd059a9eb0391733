"""Request scope of HTTP requests: an id, a span, one log line, metrics, and a problem document for errors."""

from __future__ import annotations

import time
from functools import cache

import structlog
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..problems import problem_of
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import Requests, RequestScope

_log = structlog.get_logger(__name__)
_QUIET = {"/healthz", "/readyz", "/metrics"}
_METHODS = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"}
TRANSPORT = "http"
MAX_PATH_CHARS = 300  # a longer path is cut in the log
_NOSNIFF = (b"x-content-type-options", b"nosniff")
CLIENT_GONE = 499  # nginx's status for it; nobody reads the answer


class RequestLog:
    """ASGI middleware. Every answer has an X-Request-Id: the caller's, if it is well-formed.

    Every answer also forbids browsers to guess another type than that in its header: names that callers gave
    stay text.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics, requests: Requests) -> None:
        self._app = app
        # Finding a series by its labels takes longer than counting in it. There are few series.
        self._count = cache(metrics.http_requests.labels)
        self._seconds = cache(metrics.http_seconds.labels)
        self._requests = requests

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one request within its scope."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        start = time.monotonic()
        with self._requests.scope(
            TRANSPORT,
            None if scope["path"] in _QUIET else scope["method"],
            request_id=headers.get(b"x-request-id", b"").decode("latin-1"),
            traceparent=headers.get(b"traceparent", b"").decode("latin-1"),
            started=start,
        ) as request:
            await self._answer(request, scope, receive, send)

    async def _answer(self, request: RequestScope, scope: Scope, receive: Receive, send: Send) -> None:
        own_headers = [(b"x-request-id", request.request_id.encode()), _NOSNIFF]
        status = 0

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message = {
                    **message,
                    "headers": [*message["headers"], *own_headers],
                }
            await send(message)

        try:
            await self._app(scope, receive, send_with_id)
        except ClientDisconnect:
            status = CLIENT_GONE
        except Exception as error:
            _log.exception("unexpected error")
            if status:  # the answer is under way: the connection must break
                raise
            await problem_of(error).response()(scope, receive, send_with_id)
        finally:
            request.status = status
            self._record(request, scope)

    def _record(self, request: RequestScope, scope: Scope) -> None:
        route = getattr(scope.get("route"), "path", "unknown")
        method = scope["method"] if scope["method"] in _METHODS else "other"
        self._count(method, route, str(request.status)).inc()
        self._seconds(route).observe(request.seconds)
        path = scope["path"][:MAX_PATH_CHARS]
        if request.span is not None:
            request.span.update_name(f"{method} {route}")
            attributes = {"http.request.method": method, "http.route": route, "url.path": path}
            request.span.set_attributes({**attributes, "http.response.status_code": request.status})
        log = _log.debug if route in _QUIET else _log.info
        log("request", method=method, path=path, **request.line)
