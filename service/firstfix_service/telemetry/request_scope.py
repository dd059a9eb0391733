"""What belongs to one request of either transport: its ids, its span, and what its line in the log says.

Whoever works for the request adds to it by ``note``, from any task or thread that runs in its context.
"""

from __future__ import annotations

import contextvars
import re
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import structlog

from firstfix.trace_context import TraceContext

from .tracing import Tracing, started_ns

if TYPE_CHECKING:
    from opentelemetry.trace import Span

P = ParamSpec("P")
T = TypeVar("T")
_GOOD_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass
class RequestScope:
    """One request.

    Attributes:
        started: of ``time.monotonic``.
        trace: its own span's place in the trace, or where nothing is traced here the caller's.
        span: None where nothing is traced here.
        status: of the answer, as HTTP says it; 0: none was given.
        fields: of its line in the log; its span gets them too, as ``firstfix.*``.
    """

    request_id: str
    transport: str
    started: float
    trace: TraceContext | None
    span: Span | None
    status: int = 0
    fields: dict[str, Any] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Since it began."""
        return time.monotonic() - self.started

    @property
    def line(self) -> dict[str, Any]:
        """What the log says of a request besides its ids, method and path."""
        return {"status": self.status, "ms": round(self.seconds * 1e3, 2), **self.fields}


_current: ContextVar[RequestScope | None] = ContextVar("firstfix_request", default=None)


def current_request() -> RequestScope | None:
    return _current.get()


def note(**fields: Any) -> None:
    """Adds to the log line and the span of the request that is being served; without one: nothing."""
    scope = _current.get()
    if scope is not None:
        scope.fields.update(fields)


def with_traceparent(record: Mapping[str, Any]) -> dict[str, Any]:
    """The record with the trace that it comes from, so that whoever works on it later goes on with it."""
    scope = _current.get()
    if scope is None or scope.trace is None:
        return dict(record)
    return {**record, "traceparent": scope.trace.traceparent}


def in_this_context(work: Callable[P, T]) -> Callable[P, T]:
    """Work that a thread does as part of the request that is being served here."""
    context = contextvars.copy_context()

    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        return context.run(work, *args, **kwargs)

    return run


class Requests:
    """Opens the scopes of one app's requests.

    Attributes:
        tracing: set when the app starts; None: no spans.
    """

    def __init__(self) -> None:
        self.tracing: Tracing | None = None

    @contextmanager
    def scope(
        self, transport: str, name: str | None, *, request_id: str, traceparent: str | None, started: float
    ) -> Iterator[RequestScope]:
        """
        Args:
            name: of the span; None: the request is not worth one.
            request_id: the caller's; kept if it is harmless, else one is made.
            traceparent: the caller's, if any.
            started: of ``time.monotonic``.
        """
        caller = TraceContext.parse(traceparent)
        span: Span | None = None
        with ExitStack() as stack:
            if self.tracing is not None and name is not None:
                span = stack.enter_context(self.tracing.request(name, caller, started_ns(started)))
            own = None if span is None else TraceContext.of(span)
            chosen = request_id if _GOOD_ID.fullmatch(request_id) else uuid.uuid4().hex
            scope = RequestScope(chosen, transport, started, own or caller, span)
            stack.enter_context(structlog.contextvars.bound_contextvars(**_ids(scope)))
            token = _current.set(scope)
            try:
                yield scope
            finally:
                _current.reset(token)
                self._finish(scope)

    def _finish(self, scope: RequestScope) -> None:
        if self.tracing is None or scope.span is None:
            return
        about = {**scope.fields, **_told(scope), "status": scope.status}
        scope.span.set_attributes({f"firstfix.{key}": value for key, value in about.items()})
        if scope.status >= 500:
            self.tracing.fail(scope.span, str(scope.fields.get("code", scope.status)))


def _told(scope: RequestScope) -> dict[str, str]:
    return {"request_id": scope.request_id, "transport": scope.transport}


def _ids(scope: RequestScope) -> dict[str, str]:
    """What every line in the log says that is written on behalf of the request."""
    ids = _told(scope)
    if scope.trace is not None:
        ids |= {"trace_id": scope.trace.trace_id, "span_id": scope.trace.span_id}
    return ids
