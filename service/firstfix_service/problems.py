"""RFC 9457 problem documents: one table from error class to status, for both transports."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from http import HTTPStatus

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import iter_route_contexts
from starlette.exceptions import HTTPException
from starlette.routing import compile_path

from firstfix import errors
from firstfix.errors import FirstfixError
from firstfix.telemetry.redact import redact

from .telemetry.request_scope import note

MEDIA_TYPE = "application/problem+json"

STATUS: dict[type[FirstfixError], int] = {
    errors.FirstfixError: 500,
    errors.InputError: 400,
    errors.InvalidScan: 422,
    errors.InvalidOption: 400,
    errors.UnsupportedFormat: 415,
    errors.MalformedData: 400,
    errors.UnfitMap: 422,
    errors.TooLarge: 413,
    errors.ChecksumMismatch: 460,
    errors.NotAcceptable: 406,
    errors.PreconditionFailed: 412,
    errors.DescriptorMismatch: 409,
    errors.NotFound: 404,
    errors.NoSuchFile: 404,
    errors.Conflict: 409,
    errors.ReadOnly: 403,
    errors.IdempotencyConflict: 409,
    errors.StoreError: 502,
    errors.StoreUnavailable: 503,
    errors.StoreUnsafe: 502,
    errors.UnreadableRecord: 502,
    errors.OutOfSpace: 507,
    errors.VersionError: 503,
    errors.CorruptVersion: 503,
    errors.IncompatibleVersion: 503,
    errors.BuildError: 500,
    errors.BuildFailed: 500,
    errors.NothingToPatch: 409,
    errors.BuildAttemptsExceeded: 500,
    errors.BuildTimedOut: 500,
    errors.BuildStalled: 500,
    errors.ClusterUnavailable: 503,
    errors.BuildCancelled: 409,
    errors.Unauthorized: 401,
    errors.ClockSkew: 401,
    errors.Forbidden: 403,
    errors.RateLimited: 429,
    errors.QuotaExceeded: 429,
    errors.Overloaded: 503,
    errors.WorkerLost: 503,
    errors.DeadlineExceeded: 504,
    errors.QueryCancelled: 499,
}
_METHOD_NOT_ALLOWED = "method_not_allowed"
TITLES = {
    460: "Checksum Mismatch",
    499: "Client Closed Request",
}  # of tus and of nginx, not registered with IANA
# Headers: when to try again; that the rest of a large body is not read.
HEADERS: dict[type[FirstfixError], dict[str, str]] = {
    errors.Unauthorized: {"WWW-Authenticate": 'Bearer realm="firstfix"'},
    errors.WorkerLost: {"Retry-After": "1"},
    errors.StoreUnavailable: {"Retry-After": "5"},
    errors.TooLarge: {"Connection": "close"},
}


@dataclass(frozen=True)
class Problem:
    """One error, ready for the wire.

    Attributes:
        headers: of the HTTP response; zenoh has none.
        members: further members of the document.
    """

    code: str
    status: int
    detail: str
    headers: dict[str, str] = field(default_factory=dict)
    members: dict[str, int | str] = field(default_factory=dict)

    @property
    def body(self) -> bytes:
        """The document: the same bytes on both transports."""
        return json.dumps(
            {
                "type": f"urn:firstfix:error:{self.code}",
                "title": TITLES.get(self.status) or HTTPStatus(self.status).phrase,
                "status": self.status,
                "detail": self.detail,
                "code": self.code,
                **self.members,
            },
            separators=(",", ":"),
        ).encode()

    def response(self) -> Response:
        """The HTTP response, and notes the code in the request's log line."""
        note(code=self.code)
        return Response(self.body, self.status, self.headers, MEDIA_TYPE)


def problem_of(error: BaseException) -> Problem:
    """The problem that a caller sees. Unexpected errors reveal no details."""
    if not isinstance(error, FirstfixError):
        return Problem(FirstfixError.code, 500, "an unexpected error, logged with the request's id")
    mapped = next(cls for cls in type(error).__mro__ if cls in STATUS)
    headers = HEADERS.get(mapped, {})
    retry_after_s = getattr(error, "retry_after_s", None)
    if retry_after_s is not None:
        headers = {"Retry-After": str(max(1, math.ceil(retry_after_s)))}
    return Problem(error.code, STATUS[mapped], redact(str(error)), headers, _members_of(error))


def _members_of(error: FirstfixError) -> dict[str, int | str]:
    if isinstance(error, errors.ClockSkew):
        return {"time_ms": error.time_ms}
    if isinstance(error, errors.NotFound) and error.nearest:
        return {"nearest": error.nearest}
    return {}


def method_not_allowed(allowed: Iterable[str]) -> Problem:
    """The problem of a method that a route does not have."""
    status = HTTPStatus.METHOD_NOT_ALLOWED
    return Problem(_METHOD_NOT_ALLOWED, int(status), status.phrase, {"Allow": ", ".join(sorted(allowed))})


def add_handlers(app: FastAPI) -> None:
    """Turn every error of a route into a problem document."""
    app.add_exception_handler(FirstfixError, _on_firstfix_error)
    app.add_exception_handler(RequestValidationError, _on_validation_error)
    app.add_exception_handler(HTTPException, _on_http_exception)


async def _on_firstfix_error(request: Request, error: Exception) -> Response:
    return problem_of(error).response()


async def _on_validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    parts = [f"{'.'.join(str(p) for p in item['loc'])}: {item['msg']}" for item in error.errors()]
    return problem_of(errors.InputError("; ".join(parts))).response()


async def _on_http_exception(request: Request, error: Exception) -> Response:
    """Refusals by the framework: unknown path or method."""
    assert isinstance(error, HTTPException)
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        return method_not_allowed(_methods_of(request)).response()
    code = errors.NotFound.code if error.status_code == HTTPStatus.NOT_FOUND else errors.InputError.code
    return Problem(code, error.status_code, str(error.detail), dict(error.headers or {})).response()


def _methods_of(request: Request) -> set[str]:
    """All methods that the request's path has: each has a route of its own, and the framework names one."""
    path, routes = request.scope["path"], iter_route_contexts(request.app.routes)
    with_path = (route for route in routes if route.path and _pattern_of(route.path).match(path))
    return {method for route in with_path for method in route.methods or ()}


@cache
def _pattern_of(route_path: str) -> re.Pattern[str]:
    return compile_path(route_path)[0]
