"""The service as an ASGI app. Nothing is read, opened or started until its lifespan begins."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import Depends, FastAPI
from starlette.types import ASGIApp

import firstfix
from firstfix.doors import ROUTES, absent, through
from firstfix.engine.localizer import Localizer

from . import problems
from .http_api import nearest_map
from .http_api.bodies.request_body import WhilePermitted
from .http_api.edge import RequestLog, authorize, check_routes
from .http_api.openapi import DocumentedApp
from .http_api.response_budget import CountedAnswers
from .http_api.routes import (
    api_page,
    builds,
    caller,
    changes,
    garbage,
    georeference,
    keys,
    localize,
    maps,
    operations,
    patches,
    recorded_queries,
    uploads,
    versions,
)
from .http_api.routes.absent import absent_routes
from .http_api.short_way import DirectAnswers
from .limits.byte_budget import ByteBudget
from .limits.limits import Limits
from .limits.turns import Turns
from .settings import Settings
from .startup.composition import compose
from .startup.retry import PlainStartError, RetryingStart
from .telemetry.metrics import Metrics
from .telemetry.request_scope import Requests
from .telemetry.stall_watch import StallWatch

_ROUTES = (
    operations,
    api_page,
    caller,
    maps,
    versions,
    changes,
    georeference,
    uploads,
    builds,
    patches,
    recorded_queries,
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
    """The app for these settings.

    Args:
        load: makes the localizer of a version's folder. With it, queries run in threads of this process.

    Raises:
        TypeError: a route does not say what its callers need.
    """
    metrics, requests, limits = Metrics(), Requests(), Limits.of(settings)
    turns = Turns(limits)
    watch = StallWatch(metrics.event_loop_lag, settings.stalled_exit_s)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        state = app.state
        async with RetryingStart(
            lambda stack: compose(
                settings, limits, metrics, requests, turns, watch, load, state.closing, state.draining, stack
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
        docs_url=None,  # its page loads scripts from other hosts; routes/api_page has ours
        redoc_url=None,
        redirect_slashes=False,  # the target would come from the Host header
        dependencies=[Depends(authorize)],
        responses={"default": _PROBLEM},
    )
    app.state.settings, app.state.limits, app.state.metrics = settings, limits, metrics
    app.state.closing = asyncio.Event()
    app.state.draining, app.state.watch = asyncio.Event(), watch
    app.state.pages = {}  # for people, by name: paths that the log names at the start
    localize.add_route(app)
    for module in _ROUTES:
        app.include_router(module.router)
    caller.sensors_json()  # made here, not while queries wait
    for add_routes in through(ROUTES).values():
        add_routes(app)
    for package in absent():
        app.include_router(absent_routes(package))
    check_routes(app)
    problems.add_handlers(app)
    nearest_map.add_handler(app)
    answers = ByteBudget.of_answers(limits.max_unsent_bytes)
    metrics.unsent_bytes.set_function(lambda: answers.bytes)

    def logged(answer: ASGIApp) -> ASGIApp:
        """Every request passes this, whichever way it goes."""
        return RequestLog(answer, metrics, requests, settings.trusted_proxies, turns)

    app.take_short_way(logged(DirectAnswers(answers)))
    app.add_middleware(lambda routes: logged(CountedAnswers(WhilePermitted(routes), answers)))
    app.add_middleware(PlainStartError)
    return app
