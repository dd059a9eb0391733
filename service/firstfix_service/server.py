"""Running the service as a process."""

from __future__ import annotations

import asyncio
import math
import socket
from functools import partial

import structlog
import uvicorn
from fastapi import FastAPI

from .app import create_app
from .http_server.connections import ConnectionLimits, Connections, Ended
from .http_server.protocol import LimitedHttpProtocol
from .settings import Settings
from .telemetry.log_setup import set_up_logging
from .telemetry.metrics import Metrics

_log = structlog.get_logger(__name__)
STOP_WITHIN_S = 20  # for requests under way, then they are broken off


def uvicorn_config(app: FastAPI, settings: Settings) -> uvicorn.Config:
    metrics: Metrics = app.state.metrics
    limits = ConnectionLimits.of(settings)

    def ended(why: Ended) -> None:
        metrics.http_connections_ended.labels(why.value).inc()

    connections = Connections(limits, settings.trusted_proxies, ended)
    metrics.http_connections.set_function(connections.__len__)
    return uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        loop="auto",  # uvloop where it is installed
        http=partial(LimitedHttpProtocol, connections=connections),  # type: ignore[arg-type]
        ws="none",
        access_log=False,  # RequestLog writes one line a request
        log_config=None,
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=math.ceil(limits.idle_s),
        timeout_graceful_shutdown=STOP_WITHIN_S,
        lifespan="on",
    )


class Server(uvicorn.Server):
    """The server of an app. When it is to stop it says so at /readyz and goes on until a proxy has seen
    that; then it ends streams of events, and waits for what else is under way."""

    def __init__(self, app: FastAPI, settings: Settings) -> None:
        super().__init__(uvicorn_config(app, settings))
        self._app = app
        self._drain_s = settings.drain_s

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.state.draining.set()
        if self._drain_s and self.started:
            _log.info("stopping: no longer ready, requests are still answered", drain_s=self._drain_s)
            await asyncio.sleep(self._drain_s)
        self._app.state.closing.set()
        await super().shutdown(sockets)


def serve(settings: Settings) -> None:
    """Serves until SIGINT or SIGTERM.

    Raises:
        SystemExit: it could not start; the log says why.
    """
    set_up_logging(settings.log_level, as_json=settings.log_json)
    Server(create_app(settings), settings).run()
