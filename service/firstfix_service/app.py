"""The service as an ASGI app. Nothing is read, opened or started until its lifespan begins."""

from __future__ import annotations

import asyncio
import shutil
import time
import uuid
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import structlog
from fastapi import FastAPI

import firstfix
from firstfix.catalog import Catalog
from firstfix.georeferences import Georeferences
from firstfix.store import Store
from firstfix.uploads import Uploads

from . import (
    http_build_events,
    http_builds,
    http_garbage,
    http_georeference,
    http_localize,
    http_maps,
    http_uploads,
    http_versions,
    operations,
    problems,
)
from .build_queue import BuildQueue, builder_is_installed
from .georeference_cache import GeoreferenceCache
from .janitor import keep_clean
from .localize import LocalizeUseCase
from .map_cache import LocalizesScans, MapCache, load_localizer
from .map_poller import MapPoller
from .metrics import Metrics
from .openapi import DocumentedApp
from .parts import Parts
from .places import Places
from .pool import QueryPool
from .request_body import BodyReader
from .request_log import RequestLog
from .settings import Settings
from .start_failure import StartFailure

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
    metrics = Metrics()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            app.state.parts = await _start(settings, metrics, load, stack, app.state.closing)
            _log.info("ready to take requests", store=settings.store)
            yield

    app = DocumentedApp(
        title="firstfix",
        version=firstfix.__version__,
        summary="The first fix for LiDAR robots: one scan in, the pose in the map out.",
        lifespan=lifespan,
        docs_url=None,  # pages that load scripts from elsewhere
        redoc_url=None,
        responses={"default": _PROBLEM},
    )
    app.state.closing = asyncio.Event()
    for module in (
        http_localize,
        http_maps,
        http_versions,
        http_georeference,
        http_uploads,
        http_builds,
        http_build_events,
        http_garbage,
        operations,
    ):
        app.include_router(module.router)
    problems.add_handlers(app)
    app.add_middleware(RequestLog, metrics=metrics)
    app.add_middleware(StartFailure)
    return app


async def _start(
    settings: Settings,
    metrics: Metrics,
    load: Callable[[Path], LocalizesScans],
    stack: AsyncExitStack,
    closing: asyncio.Event,
) -> Parts:
    """Starts everything in order; the stack stops it in the reverse order."""
    store = await asyncio.to_thread(_open_store, settings.store)
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
    use_case = LocalizeUseCase(maps, pool, metrics, max_decoded_bytes=settings.max_decoded_bytes)
    builds = _start_builds(settings, catalog, metrics, stack)
    _start_task(keep_clean(catalog), "janitor", stack)
    georeferences = Georeferences(store)
    poller = await _start_poller(settings, maps, use_case, pool, stack)
    poller.start()
    stack.push_async_callback(asyncio.to_thread, poller.close)
    return Parts(
        settings,
        metrics,
        catalog,
        maps,
        pool,
        use_case,
        bodies,
        builds,
        Uploads(store),
        Places(settings.max_upload_streams, "uploads"),
        Places(settings.max_event_streams, "streams of events"),
        georeferences,
        GeoreferenceCache(georeferences, settings.georeference_ttl_s),
        closing,
    )


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
        command=(*settings.build_command, *_source_url_options(settings)),
        work_dir=settings.work_dir,
        niceness=settings.build_niceness,
    )
    _start_task(builds.run(), "build-queue", stack)
    return builds


def _source_url_options(settings: Settings) -> list[str]:
    """The worker asks for itself which servers it may fetch from: what is on record does not say."""
    allowed = [url for url in settings.source_urls if url.startswith(("http://", "https://"))]
    return [option for url in allowed for option in ("--source-url", url)]


def _start_task(work: Coroutine[Any, Any, None], name: str, stack: AsyncExitStack) -> None:
    """Runs it until the stack stops it."""
    task = asyncio.create_task(work, name=name)

    async def stop() -> None:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    stack.push_async_callback(stop)


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
