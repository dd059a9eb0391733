"""The service as a server process."""

from __future__ import annotations

import asyncio
import math
import socket
from functools import partial

import structlog
import uvicorn
from fastapi import FastAPI

from .app import create_app
from .http_api.routes.console.page import page_files
from .http_server.connections import ConnectionLimits, Connections, EndReason
from .http_server.protocol import LimitedHttpProtocol
from .lanes import give_up_requests
from .settings import Settings
from .telemetry.log_setup import set_up_logging
from .telemetry.metrics import Metrics

_log = structlog.get_logger(__name__)
STOP_WITHIN_S = 20  # requests that run longer are aborted
STORE_WITHIN_S = 5.0  # requests that wait longer for the store get an error


def uvicorn_config(app: FastAPI, settings: Settings) -> uvicorn.Config:
    """Returns the configuration of the HTTP server."""
    metrics: Metrics = app.state.metrics
    limits = ConnectionLimits.of(settings)

    def ended(why: EndReason) -> None:
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
        access_log=False,  # RequestLog writes one line per request
        log_config=None,
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=math.ceil(limits.idle_s),
        timeout_graceful_shutdown=STOP_WITHIN_S,
        lifespan="on",
    )


class Server(uvicorn.Server):
    """The HTTP server of an app, with an orderly stop.

    To stop, it answers 503 at /readyz and goes on for ``drain_s``, so that proxies see it. Then it ends the
    event streams and waits for the other requests.
    """

    def __init__(self, app: FastAPI, settings: Settings) -> None:
        super().__init__(uvicorn_config(app, settings))
        self._app = app
        self._drain_s = settings.drain_s
        self._has_console = settings.console and bool(page_files())

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts to listen, and logs where."""
        await super().startup(sockets)
        if self.started:
            host, port = self.servers[0].sockets[0].getsockname()[:2]
            address = f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
            _log.info(
                "listening", address=address, console=f"{address}console/" if self._has_console else None
            )

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Drains and stops the server."""
        self._app.state.draining.set()
        if self._drain_s and self.started:
            _log.info("stopping: not ready any more, requests are still answered", drain_s=self._drain_s)
            await asyncio.sleep(self._drain_s)
        self._app.state.closing.set()
        giving_up = asyncio.create_task(give_up_requests(STORE_WITHIN_S, "the service is stopping"))
        await super().shutdown(sockets)
        giving_up.cancel()


def serve(settings: Settings) -> None:
    """Runs the service until SIGINT or SIGTERM.

    Raises:
        SystemExit: the service could not start; the log says why.
    """
    set_up_logging(settings.log_level, as_json=settings.log_json)
    Server(create_app(settings), settings).run()
