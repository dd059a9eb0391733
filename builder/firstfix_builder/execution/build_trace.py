"""Durations of a build's stages, for its record and as OpenTelemetry spans, and the log with their ids.

The spans continue the trace of the request that started the build (``traceparent`` in its record). They are
made only if OpenTelemetry's environment variables name a collector. Otherwise its SDK is not imported.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING

import firstfix
from firstfix.builds.options import BuildOptions
from firstfix.telemetry.library_logs import silence_libraries
from firstfix.telemetry.redact import redactor
from firstfix.telemetry.trace_context import TraceContext, is_tracing_wanted

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

SERVICE_NAME = "firstfix-builder"


@dataclass(frozen=True)
class StageTime:
    """A stage that has ended.

    Attributes:
        seconds: from its first tick to that of the next stage.
        cached: its result came from the cache.
        chunks: number of its chunks; 0: the stage has none, or came from the cache.
        chunks_reused: number of these that an earlier build had made.
    """

    stage: str
    seconds: float
    cached: bool
    chunks: int = 0
    chunks_reused: int = 0


class BuildTrace:
    """Follows one build, as a context manager. ``tick`` is cheap and may be called by any thread.

    The time starts at the first tick.

    Args:
        traceparent: in the build's record.
    """

    def __init__(
        self,
        build_id: str,
        map_id: str,
        traceparent: str | None,
        environ: Mapping[str, str] = os.environ,
    ) -> None:
        self.stages: list[StageTime] = []
        self.trace = TraceContext.parse(traceparent)
        self._about = {"firstfix.build_id": build_id, "firstfix.map_id": map_id}
        self._environ = environ
        self._lock = threading.Lock()
        self._stage = ""
        self._since_ns = 0
        self._wall_ahead_ns = 0  # of the monotonic clock, at the start: spans are dated, ages are not
        self._cached: set[str] = set()
        self._settled: set[str] = set()
        self._chunks: dict[str, tuple[int, int]] = {}
        self._outcome: tuple[str, str | None] | None = None
        self._spans: _Spans | None = None

    def __enter__(self) -> BuildTrace:
        _under_way.append(self)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Send the spans."""
        _under_way.remove(self)
        self.end("interrupted", getattr(error, "code", None))
        if self._spans is not None and self._outcome is not None:
            self._spans.end(*self._outcome, self._wall_ns(time.monotonic_ns()))

    @property
    def stage(self) -> str:
        """Name of the current stage."""
        return self._stage

    def tick(self, stage: str) -> None:
        """Note that the stage runs, and that the former one has ended."""
        with self._lock:
            if self._outcome is not None or stage == self._stage:
                return
            if self._stage:
                self._end_stage()
            else:
                self._begin()
            self._stage = stage

    def mark_cached(self, stage: str) -> None:
        """Note that the result of the current stage came from the cache."""
        with self._lock:
            if stage == self._stage and stage not in self._settled:  # not one within the provisional version
                self._cached.add(stage)

    def settle(self) -> None:
        """Note that this build has the result of the current stage: it takes it once more from the cache."""
        with self._lock:
            self._settled.add(self._stage)

    def mark_chunks(self, stage: str, count: int, reused: int) -> None:
        """Note that the stage has more chunks, and how many of them an earlier build had made."""
        with self._lock:
            if stage == self._stage:
                before = self._chunks.get(stage, (0, 0))
                self._chunks[stage] = before[0] + count, before[1] + reused

    def end(self, state: str, error_code: str | None = None) -> None:
        """End the build. Only the first call has an effect."""
        with self._lock:
            if self._outcome is None:
                if self._stage:
                    self._end_stage(error_code)
                self._outcome = state, error_code

    def _begin(self) -> None:
        self._since_ns = time.monotonic_ns()
        self._wall_ahead_ns = time.time_ns() - self._since_ns
        if is_tracing_wanted(self._environ):
            self._spans = _Spans(self._about, self.trace, self._wall_ns(self._since_ns), self._environ)
            self.trace = self._spans.trace

    def _end_stage(self, error_code: str | None = None) -> None:
        now_ns = time.monotonic_ns()
        cached = self._stage in self._cached
        seconds = round((now_ns - self._since_ns) / 1e9, 3)
        time_of = StageTime(self._stage, seconds, cached, *self._chunks.get(self._stage, (0, 0)))
        self.stages.append(time_of)
        if self._spans is not None:
            self._spans.stage(time_of, self._wall_ns(self._since_ns), self._wall_ns(now_ns), error_code)
        self._since_ns = now_ns

    def _wall_ns(self, moment_ns: int) -> int:
        return moment_ns + self._wall_ahead_ns


_inner: list[None] = []  # stages that run within other stages
_under_way: list[BuildTrace] = []  # of this process, which runs one build at a time, in all its threads


def current_build() -> BuildTrace | None:
    """The build that this process runs, or None."""
    return _under_way[-1] if _under_way else None


@contextmanager
def within_a_stage() -> Iterator[None]:
    """Marks stages that run within another stage, because their names are those of the build's own stages."""
    _inner.append(None)
    try:
        yield
    finally:
        _inner.pop()


def mark_cached(stage: str) -> None:
    """Note in the current build, if any, that the result of a stage came from the cache."""
    build = current_build()
    if build is not None and not _inner:
        build.mark_cached(stage)


def mark_chunks(stage: str, count: int, reused: int) -> None:
    """Note in the current build, if any, the number of a stage's chunks and of the reused ones."""
    build = current_build()
    if build is not None:
        build.mark_chunks(stage, count, reused)


class _Spans:
    """Spans of the build and of its stages."""

    def __init__(
        self, about: Mapping[str, str], parent: TraceContext | None, start_ns: int, environ: Mapping[str, str]
    ) -> None:
        from opentelemetry import trace
        from opentelemetry.context import Context
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

        carrier = {} if parent is None else {"traceparent": parent.traceparent}
        self._trace = trace
        self._provider = _provider(environ)
        self._tracer = self._provider.get_tracer("firstfix", firstfix.__version__)
        self._build = self._tracer.start_span(
            "build",
            TraceContextTextMapPropagator().extract(carrier, Context()),
            trace.SpanKind.CONSUMER,
            attributes=dict(about),
            start_time=start_ns,
        )
        self.trace = TraceContext.of(self._build)

    def stage(self, stage: StageTime, start_ns: int, end_ns: int, error_code: str | None) -> None:
        attributes: dict[str, bool | int] = {"firstfix.cached": stage.cached}
        if stage.chunks:
            attributes |= {
                "firstfix.chunks": stage.chunks,
                "firstfix.chunks_reused": stage.chunks_reused,
            }
        span = self._tracer.start_span(
            stage.stage,
            self._trace.set_span_in_context(self._build),
            attributes=attributes,
            start_time=start_ns,
        )
        if error_code is not None:
            span.set_status(self._trace.Status(self._trace.StatusCode.ERROR, error_code))
        span.end(end_ns)

    def end(self, state: str, error_code: str | None, end_ns: int) -> None:
        self._build.set_attribute("firstfix.state", state)
        if error_code is not None:
            self._build.set_attribute("firstfix.code", error_code)
            self._build.set_status(self._trace.Status(self._trace.StatusCode.ERROR, error_code))
        self._build.end(end_ns)
        self._provider.shutdown()


def _provider(environ: Mapping[str, str]) -> TracerProvider:
    from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import BatchSpanProcessor

    named = {} if environ.get("OTEL_SERVICE_NAME") else {"service.name": SERVICE_NAME}
    provider = TracerProvider(resource=Resource.create({"service.version": firstfix.__version__, **named}))
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return provider


_PLAIN = "%(asctime)s %(levelname)s %(name)s %(message)s"


def set_up_build_log(options: BuildOptions) -> None:
    """Set up the log of this process. Called by the ``main`` of a process, never by an import."""
    handler = logging.StreamHandler()
    handler.setFormatter(
        _HidingSecrets(_JsonLines(options.build_id) if options.log_json else logging.Formatter(_PLAIN))
    )
    logging.basicConfig(level=options.log_level.upper(), handlers=[handler], force=True)
    silence_libraries()


class _HidingSecrets(logging.Formatter):
    def __init__(self, lines: logging.Formatter) -> None:
        super().__init__()
        self._lines = lines
        self._redact = redactor()

    def format(self, record: logging.LogRecord) -> str:
        return self._redact(self._lines.format(record))


class _JsonLines(logging.Formatter):
    def __init__(self, build_id: str) -> None:
        super().__init__()
        self._build_id = build_id

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "event": record.getMessage(),
            "level": record.levelname.lower(),
            "logger": record.name,
            "timestamp": datetime.fromtimestamp(record.created, timezone.utc).isoformat(),
            "build_id": self._build_id,
        }
        build = current_build()
        if build is not None:
            line["stage"] = build.stage
            if build.trace is not None:
                line |= {"trace_id": build.trace.trace_id, "span_id": build.trace.span_id}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line)
