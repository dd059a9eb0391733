"""The service as an ASGI app. Nothing is read, opened or started until its lifespan begins."""

from __future__ import annotations

import asyncio
import shutil
import time
import uuid
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path

import structlog
from fastapi import FastAPI

import firstfix
from firstfix.catalog import Catalog
from firstfix.store import Store

from . import http_builds, http_localize, http_maps, operations, problems
from .build_queue import BuildQueue, builder_is_installed
from .localize import LocalizeUseCase
from .map_cache import MapCache
from .map_poller import MapPoller
from .metrics import Metrics
from .parts import Parts
from .pool import QueryPool
from .process_workers import ProcessWorkers
from .query import LocalizesScans, load_localizer
from .request_body import BodyReader
from .request_log import RequestLog
from .settings import Settings
from .start_failure import StartFailure
from .workers import LocalWorkers, Workers

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


def create_app(settings: Settings, *, load: Callable[[Path], LocalizesScans] | None = None) -> FastAPI:
    """The app for these settings.

    Args:
        load: a version's folder to what answers from it, in threads of this process whatever the settings.
    """
    metrics = Metrics()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            app.state.parts = await _start(settings, metrics, load, stack)
            _log.info("ready to take requests", store=settings.store)
            yield

    app = FastAPI(
        title="firstfix",
        version=firstfix.__version__,
        summary="The first fix for LiDAR robots: one scan in, the pose in the map out.",
        lifespan=lifespan,
        docs_url=None,  # pages that load scripts from elsewhere
        redoc_url=None,
        responses={"default": _PROBLEM},
    )
    for module in (http_localize, http_maps, http_builds, operations):
        app.include_router(module.router)
    problems.add_handlers(app)
    app.add_middleware(RequestLog, metrics=metrics)
    app.add_middleware(StartFailure)
    return app


async def _start(
    settings: Settings,
    metrics: Metrics,
    load: Callable[[Path], LocalizesScans] | None,
    stack: AsyncExitStack,
) -> Parts:
    """Starts everything in order; the stack stops it in the reverse order."""
    store = await asyncio.to_thread(_open_store, settings.store)
    catalog = Catalog(store)
    await asyncio.to_thread(_remove_abandoned_uploads, settings.work_dir / "uploads")
    workers = _workers(settings, metrics, load)
    maps = MapCache(
        catalog,
        settings.cache_dir,
        workers,
        metrics,
        max_versions=settings.cache_max_versions,
        max_bytes=settings.cache_max_bytes,
        max_disk_bytes=settings.cache_max_disk_bytes,
        pinned=settings.pinned_maps,
        poll_interval_s=settings.poll_interval_s,
        sweep_interval_s=settings.sweep_interval_s,
    )
    stack.push_async_callback(asyncio.to_thread, maps.close)
    stack.push_async_callback(asyncio.to_thread, workers.close)  # first: it ends the loads under way
    pool = QueryPool(settings.workers, settings.queue_size)
    stack.push_async_callback(pool.close)
    metrics.watch("firstfix_queries_admitted", "Queries that wait or run", lambda: pool.admitted)
    bodies = BodyReader(settings.max_body_bytes, settings.max_inflight_bytes, settings.body_timeout_s)
    metrics.watch("firstfix_body_bytes", "Bytes of query bodies held", lambda: bodies.inflight_bytes)
    use_case = LocalizeUseCase(maps, pool, workers, metrics, max_decoded_bytes=settings.max_decoded_bytes)
    builds = _start_builds(settings, catalog, metrics, stack)
    poller = await _start_poller(settings, maps, use_case, pool, stack)
    poller.start()
    stack.push_async_callback(asyncio.to_thread, poller.close)
    return Parts(settings, metrics, catalog, maps, pool, use_case, bodies, builds)


def _workers(settings: Settings, metrics: Metrics, load: Callable[[Path], LocalizesScans] | None) -> Workers:
    if load is None and settings.worker_processes:
        return ProcessWorkers(
            settings.workers,
            query_timeout_s=settings.query_timeout_s,
            on_death=metrics.worker_deaths.inc,
        )
    return LocalWorkers(load or load_localizer)


def _open_store(url: str) -> Store:
    store = Store.open(url)
    store.probe()
    return store


def _start_builds(
    settings: Settings, catalog: Catalog, metrics: Metrics, stack: AsyncExitStack
) -> BuildQueue | None:
    wanted = builder_is_installed() if settings.run_builds is None else settings.run_builds
    if not wanted:
        return None
    builds = BuildQueue(
        catalog,
        metrics,
        store_url=settings.store,
        command=settings.build_command,
        work_dir=settings.work_dir,
        niceness=settings.build_niceness,
    )
    task = asyncio.create_task(builds.run(), name="build-queue")

    async def stop() -> None:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    stack.push_async_callback(stop)
    return builds


async def _start_poller(
    settings: Settings, maps: MapCache, use_case: LocalizeUseCase, pool: QueryPool, stack: AsyncExitStack
) -> MapPoller:
    """The poller, not yet running; with zenoh it keeps the liveliness tokens in step."""
    if not settings.zenoh_enabled:
        return MapPoller(maps, settings.poll_interval_s)
    from .zenoh_endpoint import ZenohEndpoint

    replica = settings.replica or uuid.uuid4().hex[:12]
    endpoint = await asyncio.to_thread(
        ZenohEndpoint, settings, replica, use_case, pool, asyncio.get_running_loop()
    )
    stack.push_async_callback(asyncio.to_thread, endpoint.close)
    _log.info("answering over zenoh", replica=replica)
    return MapPoller(maps, settings.poll_interval_s, after=lambda: endpoint.show_maps(maps.map_ids))


def _remove_abandoned_uploads(directory: Path) -> None:
    """What a killed service left; another one on this machine may be receiving the young ones."""
    if not directory.is_dir():
        return
    for folder in directory.iterdir():
        if time.time() - folder.stat().st_mtime > ABANDONED_UPLOAD_S:
            shutil.rmtree(folder, ignore_errors=True)
