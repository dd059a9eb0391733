"""The service as an ASGI app. Nothing is read, opened or started until its lifespan begins."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import Depends, FastAPI

import firstfix
from firstfix.engine.localizer import Localizer

from . import problems
from .auth.permission import WhilePermitted
from .http_api.answer_room import AnswerRoom, CountedAnswers
from .http_api.edge import authorize, refuse_changes
from .http_api.openapi import DocumentedApp
from .http_api.request_log import RequestLog
from .http_api.routes import (
    build_events,
    builds,
    changes,
    garbage,
    georeference,
    keys,
    localize,
    maps,
    operations,
    samples,
    uploads,
    versions,
)
from .http_api.routes.console import answer_events, caller, cloud, overlay, page, sensors
from .http_api.stranger_pace import StrangerPace
from .settings import Settings
from .startup.composition import compose
from .startup.retry import PlainStartError, RetryingStart
from .telemetry.metrics import Metrics
from .telemetry.request_scope import Requests
from .telemetry.stall_watch import StallWatch

_OF_THE_STORE = (
    maps,
    versions,
    cloud,
    changes,
    georeference,
    uploads,
    builds,
    build_events,
    answer_events,
    samples,
    keys,
    garbage,
)
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


def create_app(settings: Settings, *, load: Callable[[Path], Localizer] | None = None) -> FastAPI:
    """Returns the app for these settings.

    Args:
        load: makes the localizer of a version's folder. With it, queries run in threads of this process.
    """
    metrics, requests = Metrics(), Requests()
    watch = StallWatch(metrics.event_loop_lag, settings.stalled_exit_s)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        state = app.state
        async with RetryingStart(
            lambda stack: compose(
                settings, metrics, requests, watch, load, state.closing, state.draining, stack
            )
        ) as state.start:
            watch.start(asyncio.get_running_loop())
            try:
                yield
            finally:
                watch.close()

    app = DocumentedApp(
        title="firstfix",
        version=firstfix.__version__,
        summary="The first fix for LiDAR robots: one scan in, the pose in the map out.",
        lifespan=lifespan,
        docs_url=None,  # its page loads scripts from other hosts
        redoc_url=None,
        redirect_slashes=False,  # the target would come from the Host header
        dependencies=[Depends(authorize)],
        responses={"default": _PROBLEM},
    )
    app.state.settings, app.state.metrics, app.state.closing = settings, metrics, asyncio.Event()
    app.state.draining, app.state.watch = asyncio.Event(), watch
    localize.add_route(app)
    app.include_router(operations.router)
    if settings.console:
        page.page_files()  # packed here, not while queries wait
        app.include_router(page.router)
    app.include_router(caller.router)
    app.include_router(sensors.router)
    app.include_router(overlay.router)
    for module in _OF_THE_STORE:
        app.include_router(module.router, dependencies=[Depends(refuse_changes)])
    problems.add_handlers(app)
    app.add_middleware(WhilePermitted)
    room = AnswerRoom(settings.max_unsent_bytes)
    metrics.unsent_bytes.set_function(lambda: room.taken_bytes)
    app.add_middleware(CountedAnswers, room=room, settings=settings)
    app.add_middleware(RequestLog, metrics=metrics, requests=requests)
    app.add_middleware(StrangerPace, settings=settings)
    app.add_middleware(PlainStartError)
    return app
