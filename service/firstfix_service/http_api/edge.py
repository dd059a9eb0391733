"""Edge of HTTP: who calls a route and may, whose turn it is, and the log line of each request."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, TypeVar

import structlog
from fastapi import Depends, FastAPI, Request, Response
from fastapi.routing import APIRoute, iter_route_contexts
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as ASGIScope

from firstfix.access.permissions import Scope
from firstfix.catalog.catalog import Catalog
from firstfix.errors import NotFound, ReadOnly, Unauthorized

from ..auth.authenticate import Authenticator, Permission
from ..auth.principal import Needs, Principal, Rate
from ..http_server.streams import ANSWER_WHOLE, PIECE_BYTES, AnswerWhole
from ..limits.addresses import Network, address_of
from ..limits.turns import Turns
from ..problems import problem_of
from ..settings import Settings
from ..telemetry.log_lines import RequestLines
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import Requests, RequestScope, note
from ..thread_pools import AUTH
from .parts import part_of
from .turns import PROBES, turn_of

Route = TypeVar("Route", bound=Callable[..., Any])

_log = structlog.get_logger(__name__)
TRANSPORT = "http"
MAX_PATH_CHARS = 300  # a longer path is cut in the log
CLIENT_GONE = 499  # nginx's status for it; nobody reads the answer
_READING = frozenset({"GET", "HEAD", "OPTIONS"})
_METHODS = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"}
_QUIET = {*PROBES, "/metrics"}
_UNSAID = Needs(Scope.ADMIN)  # no route of this app
_NOTHING: Mapping[str, Any] = MappingProxyType({})
_NOSNIFF = (b"x-content-type-options", b"nosniff")


def needs(scope: Scope, rate: Rate = "", *, has_queue: bool = False) -> Callable[[Route], Route]:
    """Mark the function of a route with what its callers need.

    Args:
        rate: limit that requests count against. Reads of much data count as queries do.
        has_queue: see ``Needs``.
    """
    return lambda route: _marked(route, Needs(scope, rate, has_queue))


def public(route: Route) -> Route:
    """Mark the function of a route that everybody may call. Large answers are in memory once, for all."""
    return _marked(route, None)


def _marked(route: Route, what: Needs | None) -> Route:
    route.__dict__["needs"] = what
    return route


def needs_of(scope: ASGIScope) -> Needs | None:
    """Needs of the route's callers; None if it is public."""
    found: Needs | None = getattr(scope.get("endpoint"), "needs", _UNSAID)
    return found


def check_routes(app: FastAPI) -> None:
    """Check that each route says what its callers need, and that ``authorize`` sees their requests.

    Raises:
        TypeError: names the first route that does not.
    """
    for route in iter_route_contexts(app.routes):
        if not hasattr(route.endpoint, "needs"):
            raise TypeError(f"{route.path} does not say what it needs: mark its function @needs or @public")
        is_asked = isinstance(route.original_route, APIRoute)
        if not is_asked and needs_of({"endpoint": route.endpoint}) is not None:
            raise TypeError(f"{route.path} needs a caller, and only routes of FastAPI ask for one")


async def authorize(request: Request) -> None:
    """Let a request pass in its turn, or refuse it, before its body is read. A dependency of every route.

    Stores the ``Principal`` in ``request.state.caller`` and the ``Permission``, for later checks, in
    ``request.state.permission``. Checks the map or build in the path. Routes check the maps in a body or in
    query parameters.

    Raises:
        Unauthorized, Forbidden, RateLimited: the request is refused.
        NotFound: the build belongs to a map that the caller may not see.
        ReadOnly: the request would change something. The store, which is opened read-only, refuses it too.
        ClientDisconnect: the caller has gone before it was its turn.
    """
    scope = request.scope
    needs = needs_of(scope)
    if needs is None or (needs.scope is Scope.METRICS and _are_metrics_open(request)):
        await turn_of(scope).wait_to_begin()
        return  # also before the store has answered
    state, in_path = scope["state"], scope.get("path_params", _NOTHING)
    authenticator, map_id = part_of(request, Authenticator), in_path.get("map_id")
    credential, address = _credential(request), state["address"]
    caller = await authenticator.authenticate(credential, address)
    if not needs.has_queue:
        note(caller=caller.name)
        if await turn_of(scope).wait_to_begin(caller.name):
            caller = await authenticator.authenticate(credential, address)  # its key may be revoked by now
    authenticator.permit(caller, needs, map_id)
    state["caller"] = caller
    state["permission"] = Permission(authenticator, credential, address, needs.scope, map_id)
    if (build_id := in_path.get("build_id")) is not None and not caller.sees_every_map:
        status = await AUTH.run(part_of(request, Catalog).builds.shown_status, build_id)
        if not caller.sees(status["map_id"]):
            raise NotFound(f"no build {build_id}")
    is_change = scope["method"] not in _READING and needs.scope is not Scope.LOCALIZE
    if is_change and _settings_of(request).read_only:
        raise ReadOnly("this service is read-only (FIRSTFIX_READ_ONLY): use one that is not")


async def caller_of(request: Request) -> Principal:
    """The caller of an authorized request."""
    caller: Principal = request.scope["state"]["caller"]
    return caller


async def _permission_of(request: Request) -> Permission:
    permission: Permission = request.state.permission
    return permission


def _settings_of(request: Request) -> Settings:
    settings: Settings = request.app.state.settings
    return settings


def _are_metrics_open(request: Request) -> bool:
    settings = _settings_of(request)
    return settings.metrics_public or settings.auth != "on"


CallerDep = Annotated[Principal, Depends(caller_of)]
PermissionDep = Annotated[Permission, Depends(_permission_of)]


def _credential(request: Request) -> str | None:
    """The credential in the header; None without the header. URLs end up in logs, so none is read there.

    Raises:
        Unauthorized: the header is malformed.
    """
    headers = request.scope["headers"]
    if b"authorization" not in dict(headers):
        return None
    given = [value for name, value in headers if name == b"authorization"]
    scheme, _, credential = given[0].decode("latin-1").partition(" ")
    if len(given) > 1 or scheme.lower() != "bearer" or not credential.strip():
        raise Unauthorized("a credential comes in one header Authorization, after the word Bearer")
    return credential.strip()


class LoggedAnswer:
    """The answer to a request, with the headers that every answer has, and in its turn.

    Attributes:
        status: 0: it has not begun.
    """

    def __init__(self, request: RequestScope, scope: ASGIScope, send: Send) -> None:
        self._request, self._scope, self._send = request, scope, send
        self._own_headers = ((b"x-request-id", request.request_id.encode()), _NOSNIFF)
        self.status = 0

    async def send(self, message: Message) -> None:
        """Send a message of the answer."""
        if message["type"] == "http.response.start":
            await self._take_turn(message["status"])
            message = {**message, "headers": [*message["headers"], *self._own_headers]}
        await self._send(message)

    async def send_whole(self, response: Response) -> bool:
        """Send a short answer at once. Returns False where it has to go by ``send``."""
        body = response.body
        answer_whole: AnswerWhole | None = self._scope.get("extensions", _NOTHING).get(ANSWER_WHOLE)
        if answer_whole is None or len(body) > PIECE_BYTES:
            return False
        status = self.status = response.status_code
        if status >= 400 or "caller" not in self._request.fields:
            await self._take_turn(status)
        return answer_whole(status, (*response.raw_headers, *self._own_headers), bytes(body))

    async def _take_turn(self, status: int) -> None:
        self.status = status
        caller = self._request.fields.get("caller", "")
        if not caller or status >= 400:  # else a queue has given it its turn
            await turn_of(self._scope).wait_to_answer(caller)


class RequestLog:
    """ASGI middleware that gives each request an id, a span, a log line, metrics, and a problem document.

    Every answer has an X-Request-Id: the caller's, if it is well-formed. Every answer also forbids browsers
    to guess another type than that in its header: names that callers gave stay text.
    """

    def __init__(
        self,
        app: ASGIApp,
        metrics: Metrics,
        requests: Requests,
        trusted: Iterable[Network],
        turns: Turns,
    ) -> None:
        self._app = app
        # Finding a series by its labels takes longer than counting in it. There are few series.
        self._answers = cache(metrics.http_requests.labels)
        self._seconds = cache(metrics.http_seconds.labels)
        self._late = metrics.late
        self._lines = RequestLines(__name__)
        self._requests = requests
        self._trusted = tuple(trusted)
        self._turns = turns

    async def __call__(self, scope: ASGIScope, receive: Receive, send: Send) -> None:
        """Serve one request within its scope."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        start = time.monotonic()
        state = scope.setdefault("state", {})
        state["address"] = address_of(scope, self._trusted)
        state["turns"] = self._turns
        with self._requests.scope(
            TRANSPORT,
            None if scope["path"] in _QUIET else scope["method"],
            request_id=headers.get(b"x-request-id", b"").decode("latin-1"),
            traceparent=headers.get(b"traceparent", b"").decode("latin-1"),
            started=start,
        ) as request:
            answer = state["answer"] = LoggedAnswer(request, scope, send)
            try:
                await self._app(scope, receive, answer.send)
            except ClientDisconnect:
                answer.status = CLIENT_GONE
            except Exception as error:
                _log.exception("unexpected error")
                if answer.status:  # it is under way: the connection must break
                    raise
                await problem_of(error).response()(scope, receive, answer.send)
            finally:
                request.status = answer.status
                self._record(request, scope)

    def _record(self, request: RequestScope, scope: ASGIScope) -> None:
        route = getattr(scope.get("route"), "path", "unknown")
        method = scope["method"] if scope["method"] in _METHODS else "other"
        seconds = request.seconds
        self._late.add(self._count, method, route, request.status, seconds)
        path = scope["path"][:MAX_PATH_CHARS]
        if request.span is not None:
            request.span.update_name(f"{method} {route}")
            attributes = {"http.request.method": method, "http.route": route, "url.path": path}
            request.span.set_attributes({**attributes, "http.response.status_code": request.status})
        level = logging.DEBUG if route in _QUIET else logging.INFO
        self._lines.write(request, level, method, path, seconds)

    def _count(self, method: str, route: str, status: int, seconds: float) -> None:
        self._answers(method, route, str(status)).inc()
        self._seconds(route).observe(seconds)
