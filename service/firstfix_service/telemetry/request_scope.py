"""Scope of one request of either transport: its ids, its span, and its line on the way into the log.

Any task or thread that runs in the request's context can add fields with ``note``.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Any

from firstfix.ids import check_robot_name
from firstfix.telemetry.trace_context import TraceContext

from .tracing import Tracing, started_ns

if TYPE_CHECKING:
    from opentelemetry.trace import Span

_GOOD_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass
class RequestScope:
    """One request.

    Attributes:
        started: time of arrival (``time.monotonic``).
        trace: trace context of its span; without tracing, the context that the caller sent.
        span: None without tracing.
        status: HTTP status of the answer; 0 if there was no answer.
        fields: fields of its log line; its span gets them too, as ``firstfix.*``.
        make_more: makes more of them, where they are read; None: there are no more.
    """

    request_id: str
    transport: str
    started: float
    trace: TraceContext | None
    span: Span | None
    status: int = 0
    fields: dict[str, Any] = field(default_factory=dict)
    make_more: Callable[[], dict[str, Any]] | None = None

    @property
    def all_fields(self) -> dict[str, Any]:
        """All fields of its log line."""
        return self.fields if self.make_more is None else {**self.fields, **self.make_more()}

    @property
    def seconds(self) -> float:
        """Seconds since the request arrived."""
        return time.monotonic() - self.started

    def line(self, seconds: float) -> dict[str, Any]:
        """Fields of the log line after so many seconds, besides ids, method and path."""
        return {"status": self.status, "ms": round(seconds * 1e3, 2), **self.all_fields}


_current: ContextVar[RequestScope | None] = ContextVar("firstfix_request", default=None)


current_request = _current.get  # the request that is being served, if any


def current_caller() -> str:
    """The name of the caller of the request that is being served; empty if there is none."""
    scope = _current.get()
    return "" if scope is None else str(scope.fields.get("caller", ""))


def note(**fields: Any) -> None:
    """Add fields to the log line and the span of the request that is being served, if any."""
    scope = _current.get()
    if scope is not None:
        scope.fields.update(fields)


def note_robot(name: str | None) -> None:
    """Note the name that the robot of this request goes by, if it was given.

    Raises:
        InvalidOption: it is malformed.
    """
    if name:
        note(robot=check_robot_name(name))


def with_traceparent(record: Mapping[str, Any]) -> dict[str, Any]:
    """The record with the current trace context, so that later work on it continues the trace."""
    scope = _current.get()
    if scope is None or scope.trace is None:
        return dict(record)
    return {**record, "traceparent": scope.trace.traceparent}


class Requests:
    """Factory of the request scopes of one app.

    Attributes:
        tracing: set when the app starts; None: there are no spans.
    """

    def __init__(self) -> None:
        self.tracing: Tracing | None = None

    def scope(
        self, transport: str, name: str | None, *, request_id: str, traceparent: str | None, started: float
    ) -> OpenRequest:
        """The scope of a request, which a ``with`` statement opens and ends.

        Args:
            name: of the span; None: the request gets no span.
            request_id: sent by the caller; if its form is not allowed, a new one is made.
            traceparent: sent by the caller, if any.
            started: time of arrival (``time.monotonic``).
        """
        caller = TraceContext.parse(traceparent) if traceparent else None
        span = None
        if self.tracing is not None and name is not None:
            span = self.tracing.request(name, caller, started_ns(started))
        chosen = request_id if request_id and _GOOD_ID.fullmatch(request_id) else os.urandom(16).hex()
        return OpenRequest(RequestScope(chosen, transport, started, caller, None), span, self.finish)

    def finish(self, scope: RequestScope) -> None:
        """Tell the span of a request how it ended."""
        if self.tracing is None or scope.span is None:
            return
        ids = {"request_id": scope.request_id, "transport": scope.transport}
        about = {**scope.all_fields, **ids, "status": scope.status}
        scope.span.set_attributes({f"firstfix.{key}": value for key, value in about.items()})
        if scope.status >= 500:
            self.tracing.fail(scope.span, str(scope.fields.get("code", scope.status)))


class OpenRequest:
    """The scope of one request while it is served."""

    def __init__(
        self,
        scope: RequestScope,
        span: AbstractContextManager[Span] | None,
        finish: Callable[[RequestScope], None],
    ) -> None:
        self._scope, self._span, self._finish = scope, span, finish

    def __enter__(self) -> RequestScope:
        if self._span is not None:
            self._scope.span = self._span.__enter__()
            self._scope.trace = TraceContext.of(self._scope.span)
        self._token = _current.set(self._scope)
        return self._scope

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _current.reset(self._token)
        if self._span is None:
            return
        try:
            self._finish(self._scope)
        finally:
            self._span.__exit__(kind, error, trace)
