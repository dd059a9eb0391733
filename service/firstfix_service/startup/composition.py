"""Composition of the service: its parts, started in the order of their dependencies."""

from __future__ import annotations

import asyncio
import shutil
import threading
import time
import uuid
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import structlog

import firstfix
from firstfix import native
from firstfix.builds.callers import CallerUsage
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.engine.localizer import Localizer
from firstfix.errors import InvalidOption, StoreUnavailable
from firstfix.store.store import Store

from ..auth.authenticate import Authenticator, open_authenticator
from ..builds.quota import BuildQuota
from ..builds.start import start_builds
from ..http_api.bodies.request_body import BodyReader, Pace
from ..http_api.bodies.uploads import UploadQuota
from ..http_api.event_stream import EventStreams
from ..http_api.health import HealthCheck
from ..http_api.made_once import MadeOnce
from ..http_api.parts import BuildParts, LocalizeParts, MapParts, Parts, UploadParts
from ..limits.concurrency_limit import ConcurrencyLimit
from ..limits.disk_space import DiskSpace
from ..limits.limits import Limits
from ..limits.turns import Turns
from ..localize.answer_counts import AnswerCounts
from ..localize.answer_reporter import AnswerReporter
from ..localize.query_gate import QueryGate
from ..localize.query_recorder import QueryRecorder, RecordingPolicy
from ..localize.recent_answers import RecentAnswers
from ..localize.use_case import LocalizeUseCase
from ..maintenance.cleanup import abandoned_objects_removal
from ..maintenance.clock import clock_comparison
from ..maintenance.patches import map_patches
from ..maintenance.verification import store_verification
from ..maps.coarse_maps import CoarseMaps
from ..maps.georeference_cache import GEOREFERENCE_TTL_S, GeoreferenceCache
from ..maps.map_cache import MAX_VERSIONS, MapCache
from ..maps.map_poller import MapPoller
from ..maps.placement import open_placement
from ..query_workers.base import QueryWorkers, QueryWorkerThreads
from ..query_workers.processes import QUERY_TIMEOUT_S, QueryWorkerProcesses
from ..query_workers.sightings.keeper import SightingsKeeper, sightings_maintenance
from ..security_check import check_security
from ..settings import Settings
from ..telemetry.metered_store import metered
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import Requests
from ..telemetry.stall_watch import StallWatch
from ..telemetry.tracing import start_tracing
from ..thread_pools import START
from ..thread_pools.background import close_within, run_in_background
from ..webhooks.sender import WebhookPolicy, WebhookSender
from .settings_summary import settings_summary

MAX_CHANGES, MAX_CHANGES_BYTES = 64, 32 << 20  # versions whose changes are kept as they are told
_log = structlog.get_logger(__name__)
ABANDONED_UPLOAD_S = 86400.0
# For parts that may wait for the store or zenoh when the service stops. An orchestrator kills it in the end.
CLOSE_WITHIN_S, FLUSH_WITHIN_S, ZENOH_CLOSE_WITHIN_S = 2.0, 4.0, 3.0


async def compose(
    settings: Settings,
    limits: Limits,
    metrics: Metrics,
    requests: Requests,
    turns: Turns,
    watch: StallWatch,
    load: Callable[[Path], Localizer] | None,
    closing: asyncio.Event,
    draining: asyncio.Event,
    stack: AsyncExitStack,
) -> Parts:
    """Start all parts in order; the stack stops them in reverse. After an error it can be tried again.

    Args:
        turns: of all who ask.
        watch: gets the pulses of the parts that may hang.
        load: loads a version's folder in this process; None: query workers are processes.
        closing: set when the service begins to stop.
        draining: set before ``closing``: other replicas take over while this one still answers.
    """
    check_security(settings)
    replica = settings.replica or uuid.uuid4().hex[:12]
    placement = open_placement(settings, replica)
    await _start_tracing(requests, replica, stack)
    store = metered(await START.run(_open_store, settings), metrics)
    authenticator = await stack.enter_async_context(open_authenticator(settings, limits, store, metrics))
    catalog = Catalog(store)
    await START.run(_remove_abandoned_uploads, settings.work_dir / "uploads")
    gate = QueryGate(limits)
    workers = _workers(settings, metrics, load, gate)
    coarse = CoarseMaps(catalog, settings.cache_dir / "coarse", metrics)
    maps = MapCache(
        catalog,
        settings.cache_dir,
        workers,
        metrics,
        max_versions=MAX_VERSIONS,
        max_bytes=settings.cache_max_bytes,
        max_disk_bytes=settings.cache_max_disk_bytes,
        pinned=settings.pinned_maps,
        placement=placement,
        poll_interval_s=settings.poll_interval_s,
        on_read=coarse.follow,
    )
    close_within(stack, coarse.close, CLOSE_WITHIN_S, "the coarse index")
    coarse.start()
    close_within(stack, maps.close, CLOSE_WITHIN_S, "loads of maps")
    stack.push_async_callback(START.run, workers.close)  # closed before the maps: it ends the loads under way
    sightings = SightingsKeeper(catalog, workers, metrics)
    if not settings.read_only:
        # before the workers end, after the last query
        close_within(stack, sightings.flush, FLUSH_WITHIN_S, "sightings")
    stack.push_async_callback(gate.close)
    metrics.queries_admitted.set_function(lambda: gate.admitted)
    if placement is not None:
        metrics.maps_held.set_function(placement.__len__)
        metrics.maps_held_loaded.set_function(lambda: maps.held_loaded)
        metrics.holding_replicas.set_function(lambda: len(placement.replicas))
    bodies = BodyReader(limits.max_body_bytes, gate.bodies, limits.body_timeout_s)
    metrics.body_bytes.set_function(lambda: gate.bodies.bytes)
    recorded_queries = await _open_recorded_queries(settings, store, metrics)
    recorder = _start_recorder(settings, recorded_queries, metrics, stack)
    recent = RecentAnswers(replica, metrics.late.make)
    counts = AnswerCounts(make_late=metrics.late.make)
    webhooks = await _start_webhooks(settings, metrics, stack)
    reporter = AnswerReporter(metrics, requests, recent, counts, recorder, webhooks)
    use_case = LocalizeUseCase(maps, coarse, gate, reporter)
    builds = start_builds(settings, catalog, metrics, stack)
    health = HealthCheck(maps, gate, metrics, builds)
    if not settings.read_only:
        abandoned_objects_removal(catalog).start(stack)
        clock_comparison(store, metrics).start(stack)
        map_patches(catalog, None if builds is None else builds.submit).start(stack)
        sightings_maintenance(sightings).start(stack)
        if settings.verify_bytes_per_s:
            store_verification(settings, store, metrics).start(stack)
    georeferences = Georeferences(store)
    uploads, usage = Uploads(store), CallerUsage(catalog.builds)
    upload_quota = UploadQuota(uploads, limits)
    georeference_cache = GeoreferenceCache(georeferences, GEOREFERENCE_TTL_S)
    upload_streams = ConcurrencyLimit(
        limits.max_upload_streams, limits.max_upload_streams_per_caller, "uploads"
    )
    event_streams = ConcurrencyLimit(
        limits.max_event_streams, limits.max_event_streams_per_caller, "streams of events"
    )
    made = (
        authenticator,
        catalog,
        health,
        recorded_queries,
        recent,
        counts,
        EventStreams(event_streams, closing),
        LocalizeParts(use_case, bodies, maps, georeference_cache, metrics),
        MapParts(
            catalog,
            maps,
            georeferences,
            georeference_cache,
            sightings,
            MadeOnce(MAX_CHANGES, MAX_CHANGES_BYTES),
        ),
        BuildParts(catalog, builds, BuildQuota(usage, limits), usage),
        UploadParts(
            store,
            uploads,
            upload_quota,
            upload_streams,
            Pace(limits.body_timeout_s),
            DiskSpace(limits.min_free_bytes),
            settings.work_dir / "uploads",
            settings.max_upload_bytes,
            settings.source_urls,
        ),
    )
    parts = {type(part): part for part in made}
    update_zenoh = None
    if settings.zenoh_enabled:
        update_zenoh = await _start_zenoh(
            settings, parts, gate, replica, requests, turns, watch, draining, stack
        )

    def polled() -> None:
        health.catalog_read()
        if update_zenoh is not None:
            update_zenoh()

    poller = MapPoller(maps, settings.poll_interval_s, polled, health.catalog_failed)
    poller.start()
    close_within(stack, poller.close, CLOSE_WITHIN_S, "poll of the catalog")
    _log.info(
        "ready to take requests",
        version=firstfix.__version__,
        compiled_core=native.variant,
        tracing=requests.tracing is not None,
        settings=settings_summary(settings),
    )
    return parts


def _workers(
    settings: Settings, metrics: Metrics, load: Callable[[Path], Localizer] | None, gate: QueryGate
) -> QueryWorkers:
    if load is None:
        return QueryWorkerProcesses(
            settings.workers,
            on_up=gate.add_worker,
            query_timeout_s=QUERY_TIMEOUT_S,
            max_body_bytes=settings.max_body_bytes,
            counts_sightings=not settings.read_only,
            on_death=metrics.worker_deaths.inc,
        )
    return QueryWorkerThreads(
        load,
        settings.workers,
        on_up=gate.add_worker,
        max_body_bytes=settings.max_body_bytes,
        counts_sightings=not settings.read_only,
    )


def _open_store(settings: Settings) -> Store:
    try:
        store = Store.open(settings.store, read_only=settings.read_only)
    except StoreUnavailable as error:  # a directory that cannot be made: a retry would not help
        raise InvalidOption(str(error)) from None
    store.probe()
    return store


async def _start_tracing(requests: Requests, replica: str, stack: AsyncExitStack) -> None:
    requests.tracing = await START.run(start_tracing, replica)
    if requests.tracing is not None:
        stack.push_async_callback(START.run, requests.tracing.close)


async def _open_recorded_queries(settings: Settings, store: Store, metrics: Metrics) -> RecordedQueries:
    if settings.recorded_store is None:
        return RecordedQueries(store)
    return RecordedQueries(metered(await START.run(Store.open, settings.recorded_store), metrics))


def _start_recorder(
    settings: Settings, recorded_queries: RecordedQueries, metrics: Metrics, stack: AsyncExitStack
) -> QueryRecorder | None:
    policy = RecordingPolicy.of(settings)
    if not policy.is_on:
        return None
    recorder = QueryRecorder(recorded_queries, policy, metrics)
    recorder.start()
    stack.push_async_callback(START.run, recorder.close)
    return recorder


async def _start_webhooks(
    settings: Settings, metrics: Metrics, stack: AsyncExitStack
) -> WebhookSender | None:
    policy = await START.run(WebhookPolicy.of, settings)
    if policy is None:
        return None
    sender = WebhookSender(policy, metrics)
    sender.start()
    stack.push_async_callback(START.run, sender.close)
    return sender


async def _start_zenoh(
    settings: Settings,
    parts: Parts,
    gate: QueryGate,
    replica: str,
    requests: Requests,
    turns: Turns,
    watch: StallWatch,
    draining: asyncio.Event,
    stack: AsyncExitStack,
) -> Callable[[], None]:
    """Start to answer over zenoh. Returns a callback for each poll: it lets a thread update the tokens."""
    from ..zenoh_api.answers import ZenohAnswers
    from ..zenoh_api.catalog import ZenohCatalog
    from ..zenoh_api.config import client_config
    from ..zenoh_api.endpoint import ENDPOINT_CLOSE_WITHIN_S, ZenohEndpoint
    from ..zenoh_api.replicas import ZenohReplicas
    from ..zenoh_api.threads import ZenohUpdates, in_zenoh_thread

    loop, pulse = asyncio.get_running_loop(), watch.add("zenoh")
    localize: LocalizeParts = parts[LocalizeParts]
    maps, metrics = localize.maps, localize.metrics
    endpoint = await in_zenoh_thread(
        ZenohEndpoint,
        settings,
        replica,
        localize.use_case,
        gate.bodies,
        parts[Authenticator],
        turns,
        loop,
        requests,
        pulse,
    )
    close_within(stack, endpoint.close, ENDPOINT_CLOSE_WITHIN_S, "zenoh", in_zenoh_thread)
    metrics.zenoh_connections.set_function(lambda: endpoint.connections)
    metrics.zenoh_maps.set_function(lambda: endpoint.maps_shown)
    zenoh_catalog, pools = None, [endpoint.replies]
    metrics.zenoh_replies.set_function(lambda: sum(map(len, pools)))
    # These keys need no credential. If callers need one, they are served only where zenoh has access rules.
    if settings.auth != "on" or settings.zenoh_trusted:

        def load() -> dict[str, int]:
            return {"queries": gate.admitted, "limit": settings.workers + settings.queue_size}

        zenoh_catalog = ZenohCatalog(endpoint.session, replica, maps, parts[Catalog], load)
        pools.append(zenoh_catalog.replies)
        close_within(stack, zenoh_catalog.close, ZENOH_CLOSE_WITHIN_S, "zenoh's catalog", in_zenoh_thread)
        config = client_config(settings)
        answers = await in_zenoh_thread(ZenohAnswers, endpoint.session, parts[RecentAnswers], config)
        close_within(stack, answers.close, ZENOH_CLOSE_WITHIN_S, "zenoh's answers", in_zenoh_thread)
    _log.info("answering over zenoh", replica=replica)
    replicas: ZenohReplicas | None = None
    is_polled = threading.Event()

    def update(before_each: Callable[[], None]) -> None:
        touched = maps.served.take_touched()
        try:
            offered = {map_id: maps.is_offered(map_id) for map_id in touched}
            endpoint.show_maps(offered, before_each)
            if zenoh_catalog is not None:
                zenoh_catalog.update(touched, before_each)
        except BaseException:
            maps.served.touch(touched)
            raise
        if replicas is not None and is_polled.is_set():
            replicas.join()

    updates = ZenohUpdates(update, watch.add("zenoh's updates"))
    stack.callback(updates.close)

    def polled() -> None:
        is_polled.set()
        updates.wake()

    if maps.placement is None or settings.replica_names:
        return polled

    def changed(names: frozenset[str], is_superseded: Callable[[], bool]) -> None:
        maps.set_replicas(names, updates.wake, is_superseded)

    replicas = ZenohReplicas(endpoint.session, replica, changed, client_config(settings))
    close_within(stack, replicas.close, ZENOH_CLOSE_WITHIN_S, "zenoh's replicas", in_zenoh_thread)
    maps.placement.set_replicas(await in_zenoh_thread(replicas.start))

    async def leave() -> None:
        await draining.wait()
        await in_zenoh_thread(replicas.leave)

    run_in_background(stack, leave(), "leave-replicas")
    return polled


def _remove_abandoned_uploads(directory: Path) -> None:
    """Remove old uploads of a killed service. Young ones may belong to another service on this machine."""
    if not directory.is_dir():
        return
    for folder in directory.iterdir():
        if time.time() - folder.stat().st_mtime > ABANDONED_UPLOAD_S:
            shutil.rmtree(folder, ignore_errors=True)
