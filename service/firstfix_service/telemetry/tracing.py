"""OpenTelemetry spans of requests and of the stages of queries.

Tracing is on if a variable of OpenTelemetry names a collector (OTEL_EXPORTER_OTLP_ENDPOINT); otherwise its
SDK is never imported. A thread sends the spans by OTLP over HTTP.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import firstfix
from firstfix.telemetry.trace_context import TraceContext, is_tracing_wanted

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.trace import Span

SERVICE_NAME = "firstfix"


def start_tracing(replica: str, environ: Mapping[str, str] = os.environ) -> Tracing | None:
    """Start tracing; returns None if no collector is named."""
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
        """Open the span of a request, as a child of the caller's span if there is one.

        Args:
            start_ns: nanoseconds since 1970.
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
        """Add a child span for each stage of a query, one after the other.

        A stage that ran twice has one span with the sum of both times, as in the timings of the answer.
        """
        if not span.is_recording():
            return
        context = self._trace.set_span_in_context(span)
        for stage, ms in timings_ms.items():
            end_ns = start_ns + int(ms * 1e6)
            self._tracer.start_span(stage, context, start_time=start_ns).end(end_ns)
            start_ns = end_ns

    def fail(self, span: Span, code: str, error: BaseException | None = None) -> None:
        """Mark the span as failed."""
        if error is not None:
            span.record_exception(error)
        span.set_status(self._trace.Status(self._trace.StatusCode.ERROR, code))

    def close(self) -> None:
        """Send the remaining spans, within the timeouts of OpenTelemetry."""
        self._provider.shutdown()


def started_ns(started: float) -> int:
    """Convert a reading of ``time.monotonic`` to nanoseconds since 1970."""
    return time.time_ns() - int((time.monotonic() - started) * 1e9)
