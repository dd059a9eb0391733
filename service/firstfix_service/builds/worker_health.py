"""Health and metrics of a build worker over HTTP, for an orchestrator."""

from __future__ import annotations

import asyncio
import threading
import time
from types import TracebackType

import structlog
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ..telemetry.metrics import Metrics
from .nats.builds import NatsBuilds

_log = structlog.get_logger(__name__)
PERIOD_S = 1.0
DEAD_AFTER_S = 30.0


class BuildWorkerHealth:
    """Server of GET /healthz, /readyz and /metrics, as a context manager.

    It runs in a thread of its own, so it can see whether the event loop of the build worker is alive. Without
    a port nothing is served.
    """

    def __init__(self, builds: NatsBuilds, metrics: Metrics, host: str, port: int | None) -> None:
        self._builds = builds
        self._metrics = metrics
        self._last_beat = time.monotonic()
        routes = [Route(f"/{call.__name__}", call) for call in (self.healthz, self.readyz, self.metrics)]
        self._server = None
        if port is not None:
            app = Starlette(routes=routes)
            self._server = uvicorn.Server(
                uvicorn.Config(app, host=host, port=port, access_log=False, log_config=None)
            )
        self._thread = threading.Thread(target=self._serve, daemon=True, name="build-worker-health")

    def __enter__(self) -> BuildWorkerHealth:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.should_exit = True
        self._thread.join(5.0)

    def _serve(self) -> None:
        if self._server is not None:
            try:
                self._server.run()
            except SystemExit:  # uvicorn raises this if the port is taken
                _log.error("cannot listen on the health port")

    async def beat(self) -> None:
        """Shows that the event loop is alive, until it is cancelled."""
        while True:
            self._last_beat = time.monotonic()
            await asyncio.sleep(PERIOD_S)

    def healthz(self, request: Request) -> Response:
        """Answers 200 if the event loop is alive."""
        alive = time.monotonic() - self._last_beat < DEAD_AFTER_S
        return JSONResponse({"status": "ok" if alive else "stuck"}, 200 if alive else 503)

    def readyz(self, request: Request) -> Response:
        """Answers 200 if NATS is connected."""
        ready = self._builds.connected
        return JSONResponse({"status": "ready" if ready else "NATS does not answer"}, 200 if ready else 503)

    def metrics(self, request: Request) -> Response:
        """Answers with the metrics."""
        body, media_type = self._metrics.exposition()
        return Response(body, headers={"Content-Type": media_type})
