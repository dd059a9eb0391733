"""What the service counts. Labels come from fixed sets: no map ids, no paths as they were typed."""

from __future__ import annotations

from collections.abc import Callable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

_SECONDS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
_LOAD_SECONDS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class Metrics:
    """The instruments of one app, in a registry of its own: two apps in one process do not mix."""

    def __init__(self) -> None:
        self.registry = registry = CollectorRegistry()
        self.http_requests = Counter(
            "firstfix_http_requests", "HTTP requests", ["method", "route", "status"], registry=registry
        )
        self.http_seconds = Histogram(
            "firstfix_http_seconds",
            "Time to answer an HTTP request",
            ["route"],
            buckets=_SECONDS,
            registry=registry,
        )
        self.verdicts = Counter(
            "firstfix_localizations", "Answers by verdict", ["transport", "verdict"], registry=registry
        )
        self.failures = Counter(
            "firstfix_localize_failures",
            "Queries that got an error",
            ["transport", "code"],
            registry=registry,
        )
        self.stage_seconds = Histogram(
            "firstfix_stage_seconds",
            "Time in a stage of a query",
            ["stage"],
            buckets=_SECONDS,
            registry=registry,
        )
        self.version_loads = Counter(
            "firstfix_version_loads", "Map versions loaded, or why not", ["result"], registry=registry
        )
        self.load_seconds = Histogram(
            "firstfix_version_load_seconds",
            "Time to fetch and load a map version",
            buckets=_LOAD_SECONDS,
            registry=registry,
        )
        self.versions_loaded = Gauge("firstfix_versions_loaded", "Map versions in memory", registry=registry)
        self.version_bytes = Gauge(
            "firstfix_version_bytes",
            "Bytes of the map versions in memory: their files, and what the workers hold besides",
            registry=registry,
        )
        self.maps_behind = Gauge(
            "firstfix_maps_behind",
            "Maps that answer from another version than the active one, as that one was refused",
            registry=registry,
        )
        self.worker_deaths = Counter(
            "firstfix_worker_deaths",
            "Worker processes that died and were replaced",
            registry=registry,
        )
        self.builds = Counter("firstfix_builds", "Builds ended here, by state", ["state"], registry=registry)
        self.builds_waiting = Gauge("firstfix_builds_waiting", "Builds not ended yet", registry=registry)

    def watch(self, name: str, text: str, value: Callable[[], float]) -> None:
        """A gauge that is read when somebody asks."""
        Gauge(name, text, registry=self.registry).set_function(value)

    def exposition(self) -> bytes:
        """The body of /metrics."""
        return generate_latest(self.registry)
