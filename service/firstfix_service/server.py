"""The service as a server process."""

from __future__ import annotations

import asyncio
import math
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import structlog
import uvicorn
from fastapi import FastAPI

from .app import create_app
from .http_server.protocol import LimitedHttpProtocol
from .http_server.streams import PIECE_BYTES, Receiver
from .limits.connections import Connections, EndReason
from .limits.limits import Limits
from .settings import Settings
from .startup.free_address import EXIT_NOT_STARTED, check_port
from .telemetry.log_setup import LAST_LINES_WITHIN_S, drain_log, set_up_logging
from .telemetry.metrics import Metrics
from .telemetry.stall_watch import EXIT_STALLED, Pulse, end_process
from .thread_pools import give_up_requests

_log = structlog.get_logger(__name__)
STOP_WITHIN_S = 20  # requests that run longer are aborted
STORE_WITHIN_S = 5.0  # requests that wait longer for the store get an error
REST_WITHIN_S = 15.0  # for the rest of a stop: zenoh, the store, builds


def uvicorn_config(app: FastAPI, settings: Settings) -> uvicorn.Config:
    """The configuration of the HTTP server."""
    metrics: Metrics = app.state.metrics
    limits: Limits = app.state.limits

    def ended(why: EndReason) -> None:
        metrics.http_connections_ended.labels(why.value).inc()

    connections = Connections(limits, settings.trusted_proxies, ended)
    metrics.http_connections.set_function(connections.__len__)
    room = memoryview(bytearray(PIECE_BYTES))

    def protocol(**of_uvicorn: Any) -> Receiver:
        return LimitedHttpProtocol(connections=connections, room=room, **of_uvicorn).receiver

    return uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        loop="auto",  # uvloop where it is installed
        http=protocol,  # type: ignore[arg-type]
        ws="none",
        access_log=False,  # RequestLog writes one line per request
        log_config=None,
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=math.ceil(limits.keep_alive_s),
        timeout_graceful_shutdown=STOP_WITHIN_S,
        lifespan="on",
    )


class Server(uvicorn.Server):
    """The HTTP server of an app, with an orderly stop.

    To stop, it answers 503 at /readyz and goes on for ``drain_s``, so that proxies see it. Then it ends the
    event streams and waits for the other requests.

    Args:
        owns_process: this process is nothing but this server. It is ended at once where the event loop stands
            still, or where a stop takes too long; where zenoh stands still, it is stopped in order.
    """

    def __init__(self, app: FastAPI, settings: Settings, *, owns_process: bool = False) -> None:
        super().__init__(uvicorn_config(app, settings))
        self._app = app
        self._drain_s = settings.drain_s
        self._exit_code: int | None = None  # None: as uvicorn says
        self._owns_process = owns_process
        if owns_process:
            app.state.watch.on_stall = self._stalled

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start to listen, and log where."""
        try:
            await super().startup(sockets)
        except SystemExit:  # uvicorn's; the log says why
            raise SystemExit(EXIT_NOT_STARTED) from None
        if self.started:
            host, port = self.servers[0].sockets[0].getsockname()[:2]
            address = f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
            _log.info(
                "listening",
                address=address,
                **{name: address + path for name, path in self._app.state.pages.items()},
            )

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Drains and stops the server."""
        if self._owns_process:
            self._end_if_stuck()
        self._app.state.draining.set()
        if self._drain_s and self.started:
            _log.info("stopping: not ready any more, requests are still answered", drain_s=self._drain_s)
            await asyncio.sleep(self._drain_s)
        self._app.state.closing.set()
        giving_up = asyncio.create_task(give_up_requests(STORE_WITHIN_S, "the service is stopping"))
        await super().shutdown(sockets)
        giving_up.cancel()

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """End the process as its stop says, after the last lines of the log are written.

        uvicorn raises the signal again that stopped it, which ends the process before anything else does.
        """
        with super().capture_signals():
            try:
                yield
            finally:
                if self._owns_process:
                    drain_log(LAST_LINES_WITHIN_S)
                if self._exit_code is not None:  # what stands still may hold up the interpreter's end too
                    os._exit(self._exit_code)

    def _stalled(self, pulse: Pulse) -> None:
        """End the process because a part stands still. Called by the thread of the watchdog."""
        if pulse.is_vital:
            end_process("ends the process: a part stands still", pulse.name)
        _log.critical("stops: a part stands still", part=pulse.name, exit_code=EXIT_STALLED)
        self._exit_code = EXIT_STALLED
        self._end_if_stuck()
        self.should_exit = True

    def _end_if_stuck(self) -> None:
        """End the process after the time that a stop may take."""
        timer = threading.Timer(self._drain_s + STOP_WITHIN_S + REST_WITHIN_S, self._stuck)
        timer.daemon = True
        timer.start()

    def _stuck(self) -> None:
        end_process("ends the process: it does not stop", "the stop")


def serve(settings: Settings) -> None:
    """Run the service until SIGINT or SIGTERM.

    Raises:
        StartFailed: the port is in use, or there is no such address.
        SystemExit: the service could not start; the log says why.
    """
    check_port(settings.host, settings.port)
    set_up_logging(settings)
    Server(create_app(settings), settings, owns_process=True).run()
