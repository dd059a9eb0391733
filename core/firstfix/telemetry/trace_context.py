"""Position of a request in a distributed trace: the W3C ``traceparent`` of the caller."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_TRACEPARENT = re.compile(r"([0-9a-f]{2})-([0-9a-f]{32})-([0-9a-f]{16})-([0-9a-f]{2})(-.*)?")
_SAMPLED = 0x01


@dataclass(frozen=True)
class TraceContext:
    """Identity of a span.

    Attributes:
        trace_id: 32 hex characters, not all zero.
        span_id: 16 hex characters, not all zero.
        sampled: the caller records its part of the trace.
    """

    trace_id: str
    span_id: str
    sampled: bool

    @classmethod
    def parse(cls, traceparent: str | None) -> TraceContext | None:
        """Parse a ``traceparent``. Returns None if missing or malformed (W3C 3.2)."""
        found = _TRACEPARENT.fullmatch(traceparent.strip()) if traceparent else None
        if found is None:
            return None
        version, trace_id, span_id, flags, rest = found.groups()
        if version == "ff" or (version == "00" and rest) or not int(trace_id, 16) or not int(span_id, 16):
            return None
        return cls(trace_id, span_id, bool(int(flags, 16) & _SAMPLED))

    @classmethod
    def of(cls, span: Any) -> TraceContext:
        """The identity of an OpenTelemetry span, to hand it to other processes."""
        named = span.get_span_context()
        return cls(f"{named.trace_id:032x}", f"{named.span_id:016x}", bool(named.trace_flags.sampled))

    @property
    def traceparent(self) -> str:
        """Value of the ``traceparent`` header."""
        return f"00-{self.trace_id}-{self.span_id}-{int(self.sampled):02x}"


def is_tracing_wanted(environ: Mapping[str, str]) -> bool:
    """Whether OpenTelemetry's variables name a collector for spans."""
    if environ.get("OTEL_SDK_DISABLED", "").strip().lower() == "true":
        return False
    if "otlp" not in (environ.get("OTEL_TRACES_EXPORTER") or "otlp"):
        return False
    names = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
    return any(environ.get(name) for name in names)
