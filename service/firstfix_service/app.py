"""The service as an ASGI app. Nothing is read, opened or started until its lifespan begins."""

from __future__ import annotations

import asyncio
import shutil
import time
import uuid
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import structlog
from fastapi import Depends, FastAPI

import firstfix
from firstfix.catalog import Catalog
from firstfix.query_samples import QuerySamples
from firstfix.store import Store

from . import http_builds, http_localize, http_maps, operations, problems
from .access import Access, open_access
from .authorize import authorize
from .exposure import check_exposure
from .health import Health
from .localize import LocalizeUseCase
from .map_cache import LocalizesScans, MapCache, load_localizer
from .map_poller import MapPoller
from .metered_store import metered
from .metrics import Metrics
from .parts import Parts
from .pool import QueryPool
from .query_recorder import QueryRecorder
from .request_body import BodyReader
from .request_log import RequestLog
from .request_scope import Requests
from .sample_keeper import SampleKeeper, SamplePolicy
from .settings import Settings
from .settings_summary import settings_summary
from .start_builds import start_builds
from .start_failure import StartFailure
from .tracing import start_tracing

_log = structlog.get_logger(__name__)
ABANDONED_UPLOAD_S = 86400.0
_PROBLEM = {
    "description": "a problem document (RFC 9457) with a stable `code`",
    "content": {
        problems.MEDIA_TYPE: {
            "schema": {
                "type": "object",
                "required": ["type", "title", "status", "detail", "code"],
                "properties": {
                    "type": {"type": "string"},
                    "title": {"type": "string"},
                    "status": {"type": "integer"},
                    "detail": {"type": "string"},
                    "code": {"type": "string"},
                },
            }
        }
    },
}


def create_app(settings: Settings, *, load: Callable[[Path], LocalizesScans] = load_localizer) -> FastAPI:
    """The app for these settings.

    Args:
        load: a version's folder to what answers from it.
    """
    metrics, requests = Metrics(), Requests()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            app.state.parts = await _start(settings, metrics, requests, load, stack)
            _log.info(
                "ready to take requests",
                version=firstfix.__version__,
                tracing=requests.tracing is not None,
                settings=settings_summary(settings),
            )
            yield

    app = FastAPI(
        title="firstfix",
        version=firstfix.__version__,
        summary="The first fix for LiDAR robots: one scan in, the pose in the map out.",
        lifespan=lifespan,
        docs_url=None,  # pages that load scripts from elsewhere
        redoc_url=None,
        redirect_slashes=False,  # the Host header would say where to
        dependencies=[Depends(authorize)],
        responses={"default": _PROBLEM},
    )
    for module in (http_localize, http_maps, http_builds, operations):
        app.include_router(module.router)
    problems.add_handlers(app)
    app.add_middleware(RequestLog, metrics=metrics, requests=requests)
    app.add_middleware(StartFailure)
    return app


async def _start(
    settings: Settings,
    metrics: Metrics,
    requests: Requests,
    load: Callable[[Path], LocalizesScans],
    stack: AsyncExitStack,
) -> Parts:
    """Starts everything in order; the stack stops it in the reverse order."""
    check_exposure(settings)
    replica = settings.replica or uuid.uuid4().hex[:12]
    await _start_tracing(requests, replica, stack)
    store = metered(await asyncio.to_thread(_open_store, settings.store), metrics)
    access = await stack.enter_async_context(open_access(settings, store, metrics))
    catalog = Catalog(store)
    await asyncio.to_thread(_remove_abandoned_uploads, settings.work_dir / "uploads")
    maps = MapCache(
        catalog,
        settings.cache_dir,
        metrics,
        max_versions=settings.cache_max_versions,
        max_bytes=settings.cache_max_bytes,
        load=load,
    )
    pool = QueryPool(settings.workers, settings.queue_size)
    stack.push_async_callback(asyncio.to_thread, pool.close)
    metrics.watch("firstfix_queries_admitted", "Queries that wait or run", lambda: pool.admitted)
    bodies = BodyReader(settings.max_body_bytes, settings.max_inflight_bytes, settings.body_timeout_s)
    metrics.watch("firstfix_body_bytes", "Bytes of query bodies held", lambda: bodies.inflight_bytes)
    samples = await _start_samples(settings, store, metrics, stack)
    recorder = QueryRecorder(metrics, requests, samples)
    use_case = LocalizeUseCase(maps, pool, recorder, max_decoded_bytes=settings.max_decoded_bytes)
    builds = start_builds(settings, catalog, metrics, stack)
    health = Health(maps, pool, metrics)
    show_maps = None
    if settings.zenoh_enabled:
        show_maps = await _start_zenoh(
            settings, replica, maps, use_case, pool, access, metrics, requests, stack
        )

    def polled() -> None:
        health.catalog_read()
        if show_maps is not None:
            show_maps()

    poller = MapPoller(maps, settings.poll_interval_s, polled, health.catalog_failed)
    poller.start()
    stack.push_async_callback(asyncio.to_thread, poller.close)
    return Parts(settings, metrics, catalog, maps, pool, use_case, bodies, builds, health, access)


async def _start_tracing(requests: Requests, replica: str, stack: AsyncExitStack) -> None:
    requests.tracing = await asyncio.to_thread(start_tracing, replica)
    if requests.tracing is not None:
        stack.push_async_callback(asyncio.to_thread, requests.tracing.close)


async def _start_samples(
    settings: Settings, store: Store, metrics: Metrics, stack: AsyncExitStack
) -> SampleKeeper | None:
    policy = SamplePolicy.of(settings)
    if not policy.is_on:
        return None
    if settings.samples_store is not None:
        store = metered(await asyncio.to_thread(Store.open, settings.samples_store), metrics)
    keeper = SampleKeeper(QuerySamples(store), policy, metrics)
    keeper.start()
    stack.push_async_callback(asyncio.to_thread, keeper.close)
    return keeper


def _open_store(url: str) -> Store:
    store = Store.open(url)
    store.probe()
    return store


async def _start_zenoh(
    settings: Settings,
    replica: str,
    maps: MapCache,
    use_case: LocalizeUseCase,
    pool: QueryPool,
    access: Access,
    metrics: Metrics,
    requests: Requests,
    stack: AsyncExitStack,
) -> Callable[[], None]:
    """Answers over zenoh. What it gives keeps the liveliness tokens in step, after every poll."""
    from .zenoh_endpoint import ZenohEndpoint

    endpoint = await asyncio.to_thread(
        ZenohEndpoint, settings, replica, use_case, pool, access, asyncio.get_running_loop(), requests
    )
    stack.push_async_callback(asyncio.to_thread, endpoint.close)
    metrics.zenoh_connections.set_function(lambda: endpoint.connections)
    metrics.zenoh_maps.set_function(lambda: endpoint.maps_shown)
    _log.info("answering over zenoh", replica=replica)
    return lambda: endpoint.show_maps(maps.map_ids)


def _remove_abandoned_uploads(directory: Path) -> None:
    """What a killed service left; another one on this machine may be receiving the young ones."""
    if not directory.is_dir():
        return
    for folder in directory.iterdir():
        if time.time() - folder.stat().st_mtime > ABANDONED_UPLOAD_S:
            shutil.rmtree(folder, ignore_errors=True)
