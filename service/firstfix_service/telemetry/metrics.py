"""Metrics of the service. Label values come from fixed sets: never map ids or raw paths."""

from __future__ import annotations

import platform
from functools import partial

from prometheus_client import CollectorRegistry, Counter, Gauge, Info, ProcessCollector
from prometheus_client.exposition import choose_encoder

import firstfix
from firstfix.answer.localization import Reason, Verdict
from firstfix.builds.records import FINAL_STATES
from firstfix.errors import DeadlineExceeded, FirstfixError, Overloaded
from firstfix.store.json_record import RecordKind

from .histogram import Histogram
from .late_counts import LateCounts

TRANSPORTS = ("http", "zenoh")
SIGHTINGS = ("counted", "repeated", "dropped", "full", "failed", "not_stored")
_SECONDS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
_LAG_SECONDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
_LOAD_SECONDS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
_STORE_SECONDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
_BUILD_SECONDS = (0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0, 30_000.0)
_PROBABILITIES = (0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999)


class Metrics:
    """The metrics of one app, in a registry of its own, so that two apps in one process do not mix.

    Attributes:
        late: for what is counted with each query.
    """

    def __init__(self) -> None:
        self.registry = registry = CollectorRegistry()
        self.late = LateCounts(registry)
        counter, gauge = partial(Counter, registry=registry), partial(Gauge, registry=registry)
        histogram = partial(Histogram, registry=registry)
        self.http_requests = counter("firstfix_http_requests", "HTTP requests", ["method", "route", "status"])
        self.http_seconds = histogram(
            "firstfix_http_seconds", "Time to answer an HTTP request", ["route"], buckets=_SECONDS
        )
        self.http_connections = gauge("firstfix_http_connections", "HTTP connections")
        self.http_connections_ended = counter(
            "firstfix_http_connections_ended",
            "HTTP connections that the service ended, by what the caller did not do in time",
            ["why"],
        )
        self.verdicts = counter("firstfix_localizations", "Answers by verdict", ["transport", "verdict"])
        self.failures = counter(
            "firstfix_localize_failures", "Queries that got an error", ["transport", "code"]
        )
        self.localize_seconds = histogram(
            "firstfix_localize_seconds",
            "Time from the arrival of a query to its answer or error",
            ["transport"],
            buckets=_SECONDS,
        )
        self.reasons = counter(
            "firstfix_reasons",
            "Reasons why answers were not localized; one answer can have several",
            ["reason"],
        )
        self.probability = histogram(
            "firstfix_probability", "Probability of the best hypothesis", ["verdict"], buckets=_PROBABILITIES
        )
        self.stage_seconds = histogram(
            "firstfix_stage_seconds",
            "Time in a stage of a query; queue: waiting for a query worker",
            ["stage"],
            buckets=_SECONDS,
        )
        self.cache_lookups = counter(
            "firstfix_cache_lookups",
            "Map versions that queries needed: in memory (hit) or not (miss)",
            ["result"],
        )
        self.version_evictions = counter("firstfix_version_evictions", "Map versions evicted from memory")
        self.version_loads = counter("firstfix_version_loads", "Loads of map versions, by result", ["result"])
        self.version_warm_ups = counter(
            "firstfix_version_warm_ups",
            "Warm-ups of map versions by queries with scans of their own map, by result",
            ["result"],
        )
        self.load_seconds = histogram(
            "firstfix_version_load_seconds", "Time to fetch and load a map version", buckets=_LOAD_SECONDS
        )
        self.versions_loaded = gauge("firstfix_versions_loaded", "Map versions in memory")
        self.version_bytes = gauge(
            "firstfix_version_bytes",
            "Bytes of the map versions in memory: their files, and other memory of the query workers",
        )
        self.maps_behind = gauge(
            "firstfix_maps_behind",
            "Maps that answer from an older version because the active one was refused",
        )
        self.coarse_maps = gauge(
            "firstfix_coarse_maps",
            "Maps in the coarse index, which chooses those that a query without a map searches",
        )
        self.maps_held = gauge(
            "firstfix_maps_held", "Maps that this replica holds; 0 without FIRSTFIX_HOLDERS"
        )
        self.maps_held_loaded = gauge(
            "firstfix_maps_held_loaded", "Maps that this replica holds and that are in memory"
        )
        self.holding_replicas = gauge(
            "firstfix_holding_replicas",
            "Replicas that share the maps, as this one sees it; 0 without FIRSTFIX_HOLDERS",
        )
        self.worker_deaths = counter("firstfix_worker_deaths", "Query workers that died and were replaced")
        self.builds = counter("firstfix_builds", "Builds that ended in this process, by state", ["state"])
        self.builds_waiting = gauge("firstfix_builds_waiting", "Builds that have not ended")
        self.build_stage_seconds = histogram(
            "firstfix_build_stage_seconds",
            "Time in a stage of a build that ended in this process; cached: the result was there already",
            ["stage", "cached"],
            buckets=_BUILD_SECONDS,
        )
        self.store_seconds = histogram(
            "firstfix_store_seconds",
            "Time of an operation on the object store",
            ["operation"],
            buckets=_STORE_SECONDS,
        )
        self.catalog_age = gauge(
            "firstfix_catalog_age_seconds",
            "Time since the catalog was last read; if it grows, the store does not answer",
        )
        self.store_errors = counter(
            "firstfix_store_errors",
            "Operations on the object store that failed or were refused",
            ["operation", "code"],
        )
        self.unreadable_records = counter(
            "firstfix_unreadable_records",
            "Damaged records found in the store and skipped, by kind; each is counted once",
            ["kind"],
        )
        self.verified_objects = counter(
            "firstfix_verified_objects", "Objects in the store that were verified", ["result"]
        )
        self.verify_bytes = counter("firstfix_verify_bytes", "Bytes of the store that were verified")
        self.verify_seconds = counter("firstfix_verify_seconds", "Time spent on verification of the store")
        self.damaged_objects = gauge(
            "firstfix_damaged_objects", "Damaged objects found by the last complete verification of the store"
        )
        self.clock_offset = gauge(
            "firstfix_clock_offset_seconds",
            "This machine's clock minus the store's, measured every five minutes; 0 on a read-only service",
        )
        self.zenoh_connections = gauge(
            "firstfix_zenoh_connections", "Connected zenoh routers, peers and clients"
        )
        self.zenoh_maps = gauge("firstfix_zenoh_maps", "Maps for which this replica has a zenoh token")
        self.zenoh_replies = gauge(
            "firstfix_zenoh_replies",
            "zenoh replies that are being sent; they wait for callers who do not read",
        )
        self.event_loop_lag = histogram(
            "firstfix_event_loop_lag_seconds",
            "Time until the event loop comes to a call, ten times a second",
            buckets=_LAG_SECONDS,
        )
        self.queries_admitted = gauge("firstfix_queries_admitted", "Queries that wait or run")
        self.body_bytes = gauge("firstfix_body_bytes", "Bytes of query bodies in memory")
        self.unsent_bytes = gauge(
            "firstfix_unsent_bytes", "Bytes of large answers in memory that callers have not taken in"
        )
        self.keys_age = gauge(
            "firstfix_keys_age_seconds", "Time since the API keys were read; 0 without authentication"
        )
        self.recorded_queries = counter(
            "firstfix_recorded_queries", "Queries chosen to be recorded, by result", ["result"]
        )
        self.recorded_bytes = gauge(
            "firstfix_recorded_bytes", "Bytes of recorded queries in the store, at the last count"
        )
        self.webhook_events = counter(
            "firstfix_webhook_events", "Events for the receivers of webhooks, by result", ["result"]
        )
        self.webhook_retries = counter("firstfix_webhook_retries", "Attempts of webhooks that were repeated")
        self.webhook_waiting = gauge("firstfix_webhook_waiting", "Events that wait for receivers of webhooks")
        self.sightings = counter(
            "firstfix_sightings",
            "Localized queries that were chosen to be compared with their map, by result",
            ["result"],
        )
        self.info = Info("firstfix", "This service's version", registry=registry)
        self.info.info({"version": firstfix.__version__, "python": platform.python_version()})
        ProcessCollector(registry=registry)  # process_resident_memory_bytes, process_cpu_seconds_total, ...
        self._begin_at_zero()

    def _begin_at_zero(self) -> None:
        """Make the series that alerts count: an increase is only seen if a series begins at zero."""
        for transport in TRANSPORTS:
            for verdict in Verdict:
                self.verdicts.labels(transport, verdict.value)
            for error in (Overloaded, DeadlineExceeded, FirstfixError):
                self.failures.labels(transport, error.code)
        for reason in Reason:
            self.reasons.labels(reason.value)
        for state in FINAL_STATES:
            self.builds.labels(state)
        for kind in RecordKind:
            self.unreadable_records.labels(kind.value)
        for result in ("ok", "failed"):
            self.version_warm_ups.labels(result)
        for result in SIGHTINGS:
            self.sightings.labels(result)
        for result in ("right", "damaged"):
            self.verified_objects.labels(result)

    def exposition(self, accept: str = "") -> tuple[bytes, str]:
        """The body of /metrics and its media type.

        Args:
            accept: the Accept header. It selects Prometheus text or OpenMetrics, which has exemplars.
        """
        encode, media_type = choose_encoder(accept)
        return encode(self.registry), media_type
