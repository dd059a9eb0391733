"""OpenTelemetry spans of requests and of the stages of queries.

On when OpenTelemetry's variables name a collector (OTEL_EXPORTER_OTLP_ENDPOINT), as its other variables
say; else its SDK is never imported. Spans go out by OTLP over HTTP, in a thread of their own.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import firstfix
from firstfix.trace_context import TraceContext, is_tracing_wanted

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.trace import Span

SERVICE_NAME = "firstfix"


def start_tracing(replica: str, environ: Mapping[str, str] = os.environ) -> Tracing | None:
    """None where no collector is named."""
    if not is_tracing_wanted(environ):
        return None
    from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import BatchSpanProcessor

    named = {} if environ.get("OTEL_SERVICE_NAME") else {"service.name": SERVICE_NAME}
    about = {"service.version": firstfix.__version__, "service.instance.id": replica, **named}
    provider = TracerProvider(resource=Resource.create(about))
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return Tracing(provider)


class Tracing:
    """Makes the spans of one app. Thread-safe."""

    def __init__(self, provider: TracerProvider) -> None:
        from opentelemetry import trace
        from opentelemetry.context import Context
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

        self._trace = trace
        self._propagator, self._no_context = TraceContextTextMapPropagator(), Context()
        self._provider = provider
        self._tracer = provider.get_tracer("firstfix", firstfix.__version__)

    @contextmanager
    def request(self, name: str, parent: TraceContext | None, start_ns: int) -> Iterator[Span]:
        """The span of a request, below its caller's if there is one.

        Args:
            start_ns: since 1970.
        """
        carrier = {} if parent is None else {"traceparent": parent.traceparent}
        above = self._propagator.extract(carrier, self._no_context)
        span = self._tracer.start_span(name, above, self._trace.SpanKind.SERVER, start_time=start_ns)
        try:
            with self._trace.use_span(span, record_exception=False, set_status_on_exception=False):
                yield span
        finally:
            span.end()

    def stages(self, span: Span, start_ns: int, timings_ms: Mapping[str, float]) -> None:
        """A child for each stage of a query, one after the other. A stage that was gone through twice
        is one child of both times together, as in the answer's timings."""
        if not span.is_recording():
            return
        context = self._trace.set_span_in_context(span)
        for stage, ms in timings_ms.items():
            end_ns = start_ns + int(ms * 1e6)
            self._tracer.start_span(stage, context, start_time=start_ns).end(end_ns)
            start_ns = end_ns

    def fail(self, span: Span, code: str, error: BaseException | None = None) -> None:
        """Marks the span as one that went wrong."""
        if error is not None:
            span.record_exception(error)
        span.set_status(self._trace.Status(self._trace.StatusCode.ERROR, code))

    def close(self) -> None:
        """Sends what is left, for as long as OpenTelemetry's timeouts allow."""
        self._provider.shutdown()


def started_ns(started: float) -> int:
    """Nanoseconds since 1970 of a reading of ``time.monotonic``."""
    return time.time_ns() - int((time.monotonic() - started) * 1e9)
