"""What the service counts. Labels come from fixed sets: no map ids, no paths as they were typed."""

from __future__ import annotations

import platform

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, Info, ProcessCollector
from prometheus_client.exposition import choose_encoder

import firstfix
from firstfix.answer.localization import Reason, Verdict
from firstfix.builds.records import FINAL_STATES
from firstfix.errors import DeadlineExceeded, FirstfixError, Overloaded
from firstfix.store.json_record import RecordKind

TRANSPORTS = ("http", "zenoh")
_SECONDS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
_LOAD_SECONDS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
_STORE_SECONDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
_BUILD_SECONDS = (0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0, 30_000.0)
_PROBABILITIES = (0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999)


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
        self.http_connections = Gauge("firstfix_http_connections", "HTTP connections", registry=registry)
        self.http_connections_ended = Counter(
            "firstfix_http_connections_ended",
            "HTTP connections that the service ended, by what the caller had to do in time",
            ["why"],
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
        self.localize_seconds = Histogram(
            "firstfix_localize_seconds",
            "Time from a query's arrival to its answer or error",
            ["transport"],
            buckets=_SECONDS,
            registry=registry,
        )
        self.reasons = Counter(
            "firstfix_reasons",
            "Why answers were not localized: one answer may have several",
            ["reason"],
            registry=registry,
        )
        self.probability = Histogram(
            "firstfix_probability",
            "Probability of the best place",
            ["verdict"],
            buckets=_PROBABILITIES,
            registry=registry,
        )
        self.stage_seconds = Histogram(
            "firstfix_stage_seconds",
            "Time in a stage of a query; queue: waiting for a worker",
            ["stage"],
            buckets=_SECONDS,
            registry=registry,
        )
        self.cache_lookups = Counter(
            "firstfix_cache_lookups",
            "Versions that queries asked for: in memory or not",
            ["result"],
            registry=registry,
        )
        self.version_evictions = Counter(
            "firstfix_version_evictions", "Map versions put out of memory to make room", registry=registry
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
        self.maps_held = Gauge(
            "firstfix_maps_held", "Maps that are this replica's to hold; 0 without holders", registry=registry
        )
        self.maps_held_loaded = Gauge(
            "firstfix_maps_held_loaded", "Maps held by this replica that are in memory", registry=registry
        )
        self.holding_replicas = Gauge(
            "firstfix_holding_replicas",
            "Replicas that hold the maps, as this one sees it; 0 without holders",
            registry=registry,
        )
        self.worker_deaths = Counter(
            "firstfix_worker_deaths",
            "Worker processes that died and were replaced",
            registry=registry,
        )
        self.builds = Counter("firstfix_builds", "Builds ended here, by state", ["state"], registry=registry)
        self.builds_waiting = Gauge("firstfix_builds_waiting", "Builds not ended yet", registry=registry)
        self.build_stage_seconds = Histogram(
            "firstfix_build_stage_seconds",
            "Time in a stage of a build that ended here; cached: it was done before",
            ["stage", "cached"],
            buckets=_BUILD_SECONDS,
            registry=registry,
        )
        self.store_seconds = Histogram(
            "firstfix_store_seconds",
            "Time of an operation on the object store",
            ["operation"],
            buckets=_STORE_SECONDS,
            registry=registry,
        )
        self.catalog_age = Gauge(
            "firstfix_catalog_age_seconds",
            "Time since the catalog was last read: more than a few seconds, and the store does not answer",
            registry=registry,
        )
        self.store_errors = Counter(
            "firstfix_store_errors",
            "Operations that the object store failed or refused",
            ["operation", "code"],
            registry=registry,
        )
        self.unreadable_records = Counter(
            "firstfix_unreadable_records",
            "Records in the store that were found damaged, by kind: each once, and passed over",
            ["kind"],
            registry=registry,
        )
        self.verified_objects = Counter(
            "firstfix_verified_objects",
            "Objects in the store that were read to find damage",
            ["result"],
            registry=registry,
        )
        self.verify_bytes = Counter(
            "firstfix_verify_bytes", "Bytes of the store that were read to find damage", registry=registry
        )
        self.verify_seconds = Counter(
            "firstfix_verify_seconds", "Time spent reading the store to find damage", registry=registry
        )
        self.damaged_objects = Gauge(
            "firstfix_damaged_objects",
            "Damaged objects that the last whole look through the store found",
            registry=registry,
        )
        self.zenoh_connections = Gauge(
            "firstfix_zenoh_connections", "zenoh routers, peers and clients connected with", registry=registry
        )
        self.zenoh_maps = Gauge(
            "firstfix_zenoh_maps", "Maps that this replica shows in zenoh by a token", registry=registry
        )
        self.queries_admitted = Gauge(
            "firstfix_queries_admitted", "Queries that wait or run", registry=registry
        )
        self.body_bytes = Gauge("firstfix_body_bytes", "Bytes of query bodies held", registry=registry)
        self.keys_age = Gauge(
            "firstfix_keys_age_seconds",
            "Since the API keys were read; 0 without authentication",
            registry=registry,
        )
        self.samples = Counter(
            "firstfix_samples",
            "Queries chosen to be kept, and what became of them",
            ["result"],
            registry=registry,
        )
        self.sample_bytes = Gauge(
            "firstfix_sample_bytes",
            "Bytes of kept queries in the store, when last counted",
            registry=registry,
        )
        self.info = Info("firstfix", "This service's version", registry=registry)
        self.info.info({"version": firstfix.__version__, "python": platform.python_version()})
        ProcessCollector(registry=registry)  # process_resident_memory_bytes, process_cpu_seconds_total, ...
        self._begin_at_zero()

    def _begin_at_zero(self) -> None:
        """What alerts count: the first failed build would not be a rise if its series began with it."""
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
        for result in ("right", "damaged"):
            self.verified_objects.labels(result)

    def exposition(self, accept: str = "") -> tuple[bytes, str]:
        """The body of /metrics and its media type: Prometheus text, or OpenMetrics, which has exemplars, for
        those whose Accept header asks for it."""
        encode, media_type = choose_encoder(accept)
        return encode(self.registry), media_type
