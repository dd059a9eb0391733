"""``firstfix worker``: a build worker, which takes builds from NATS and runs them until it is stopped.

The store records who runs a build and how often that failed (``firstfix.builds.attempts``). The stream only
says which builds there are. So a message that is lost, early or repeated costs some work and does no other
harm.
"""

from __future__ import annotations

import asyncio
import signal
import threading
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from types import TracebackType
from typing import Any

import structlog
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from firstfix.catalog.catalog import Catalog
from firstfix.errors import BuildAttemptsExceeded, InvalidOption, NotFound, StoreError, UnreadableRecord
from firstfix.store.store import Store

from ..maintenance.cleanup import shared_stages_removal
from ..settings import Settings
from ..telemetry.log_setup import set_up_logging
from ..telemetry.metrics import Metrics
from ..telemetry.stall_watch import StallWatch, end_process
from ..thread_pools import BUILDS
from ..thread_pools.background import end_if_cancelled, run_in_background
from .nats.builds import NatsBuilds
from .nats.queue import NatsBuildQueue
from .runner import BuildRunner, Turn
from .work_folder import WorkFolder

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
        """Show that the event loop is alive, until it is cancelled."""
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
        """Answer with the metrics."""
        body, media_type = self._metrics.exposition()
        return Response(body, headers={"Content-Type": media_type})


FETCH_S = 5.0
RETRY_S = 2.0
PUT_BACK_S = 5.0  # most likely the store does not answer


class BuildWorker:
    """Runs up to ``concurrency`` builds at a time, each in its own folder. For use by one event loop.

    Raises:
        InvalidOption: the settings name no NATS server.
    """

    def __init__(self, settings: Settings, catalog: Catalog, metrics: Metrics, concurrency: int) -> None:
        if not settings.nats_enabled:
            raise InvalidOption("a build worker needs a NATS server: --nats nats://host:4222")
        self._settings = settings
        self._catalog = catalog
        self._metrics = metrics
        self._concurrency = concurrency
        self.queue = NatsBuildQueue(settings, catalog, metrics)
        self._builds = self.queue.builds

    async def run(self) -> None:
        """Run until it is cancelled. Running builds are then stopped and go back to the queue at once."""
        async with AsyncExitStack() as stack:
            run_in_background(stack, self.queue.run(), "build-queue")
            if self._settings.shared_stages_bytes:
                shared_stages_removal(self._settings, self._catalog.store).start(stack)
            async with asyncio.TaskGroup() as slots:
                for i in range(self._concurrency):
                    slots.create_task(self._slot(i), name=f"slot-{i}")

    async def _slot(self, number: int) -> None:
        from nats.errors import Error
        from nats.errors import TimeoutError as NothingWaits

        folder = await WorkFolder.wait_for(self._settings.work_dir / f"slot-{number}", self._settings)
        runner = BuildRunner(self._catalog, self._metrics, folder, self._settings)
        waiting: Any = None
        try:
            while True:
                end_if_cancelled()
                try:
                    if not self._builds.connected:
                        await asyncio.sleep(0.2)
                        continue
                    if waiting is None:
                        await self._builds.make_streams()
                        waiting = await self._builds.waiting()
                    await runner.prepare()
                    (message,) = await waiting.fetch(1, timeout=FETCH_S)
                    await self._handle(runner, message)
                except NothingWaits:
                    continue
                except Error as error:
                    _log.warning("builds cannot be fetched", error=str(error))
                    waiting = None
                    await asyncio.sleep(RETRY_S)
                except Exception:  # a defect at one message must not end the build worker
                    _log.exception("the build worker failed")
                    await asyncio.sleep(RETRY_S)
        finally:
            await runner.close()
            folder.release()

    async def _handle(self, runner: BuildRunner, message: Any) -> None:
        build_id = message.data.decode("utf-8", errors="replace")
        try:
            async with self._renewed(message):
                turn = await runner.run(build_id)
            if turn is Turn.ENDED:
                await self._settle(build_id, message)
            else:
                await message.nak(self._delay_s(runner, build_id, turn))
        except asyncio.CancelledError:
            await message.nak()  # it is sent when the connection is closed
            raise
        except InvalidOption as error:
            _log.error("a message has an invalid build id", error=str(error))
            await message.term()
        except NotFound as error:
            await self._builds.bury(build_id, str(error))
            await message.ack_sync()
        except UnreadableRecord:  # once it is repaired, the queue finds it on record
            await message.ack_sync()
        except StoreError as error:
            _log.warning("a build waits for the store", build_id=build_id, code=error.code, error=str(error))
            await message.nak(PUT_BACK_S)

    async def _settle(self, build_id: str, message: Any) -> None:
        """Remove the message of a build that has ended, after the reason of a dead build is kept."""
        error = (await BUILDS.run(self._catalog.builds.status_or_queued, build_id))["error"]
        if error is not None and error["code"] == BuildAttemptsExceeded.code:
            await self._builds.bury(build_id, error["detail"])
        await message.ack_sync()

    def _delay_s(self, runner: BuildRunner, build_id: str, turn: Turn) -> float:
        """Delay until a build that has not ended is delivered again."""
        if turn is Turn.PUT_BACK:
            return runner.pause_s(build_id)
        return 0.1 if turn is Turn.DIED else self._settings.build_lease_s / 6

    @asynccontextmanager
    async def _renewed(self, message: Any) -> AsyncIterator[None]:
        """Keep the message from being delivered to another build worker while the block runs."""

        async def renew() -> None:
            from nats.errors import Error

            while True:
                await asyncio.sleep(self._settings.build_lease_s / 4)
                with suppress(Error):
                    await message.in_progress()

        task = asyncio.create_task(renew())
        try:
            yield
        finally:
            task.cancel()


def run_worker(settings: Settings, *, concurrency: int, health_port: int | None) -> None:
    """Run a build worker until SIGTERM or SIGINT.

    Raises:
        InvalidOption: the settings name no NATS server, or a file that cannot be used.
        StoreError: the store does not answer, or cannot be used.
    """
    set_up_logging(settings)
    store = Store.open(settings.store)
    store.probe()
    metrics = Metrics()
    worker = BuildWorker(settings, Catalog(store), metrics, concurrency)
    watch = StallWatch(metrics.event_loop_lag, settings.stalled_exit_s)
    watch.on_stall = lambda pulse: end_process("ends the process: a part stands still", pulse.name)
    with BuildWorkerHealth(worker.queue.builds, metrics, settings.host, health_port) as health:
        asyncio.run(_until_signalled(worker, health, watch))


async def _until_signalled(worker: BuildWorker, health: BuildWorkerHealth, watch: StallWatch) -> None:
    watch.start(asyncio.get_running_loop())
    signalled = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, signalled.set)
    async with AsyncExitStack() as stack:
        run_in_background(stack, health.beat(), "health")
        work = asyncio.create_task(worker.run(), name="build-worker")
        _log.info("ready to take builds")
        await asyncio.wait({work, asyncio.create_task(signalled.wait())}, return_when=asyncio.FIRST_COMPLETED)
        work.cancel()
        with suppress(asyncio.CancelledError):
            await work
    _log.info("build worker ends")
