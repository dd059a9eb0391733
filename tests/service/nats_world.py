"""Builds over a real NATS server: build worker processes, a store, and the queue of a service."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from firstfix.builds.records import FINAL_STATES
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.sources import put_source
from firstfix.store.store import Store
from firstfix_service.builds.nats import queue as nats_queue
from firstfix_service.builds.worker import BuildWorker
from firstfix_service.settings import Settings
from firstfix_service.telemetry.metrics import Metrics
from tests.nats_server import NatsServer
from tests.service.changed_constants import changed_constants
from tests.service.service_world import free_port
from tests.tiny_worker import config_telling
from tests.waiting import LIMIT_S, wait_until

TINY_WORKER = (sys.executable, "-m", "tests.tiny_worker")
LEASE_S = 2.0


@dataclass
class Worker:
    """A ``firstfix worker`` process."""

    process: subprocess.Popen[bytes]
    work: Path
    health_port: int

    def kill(self) -> None:
        """Kills the build worker, as a power cut does; its builds then end by themselves."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(LIMIT_S)

    def made(self) -> list[str]:
        """Stages that this build worker made, in order."""
        path = self.work / "slot-0" / "made.txt"
        return path.read_text().split() if path.exists() else []


@dataclass
class NatsWorld:
    folder: Path
    server: NatsServer
    catalog: Catalog
    environment: dict[str, str] = field(default_factory=dict)
    workers: list[Worker] = field(default_factory=list)
    threads: ExitStack = field(default_factory=ExitStack)
    count: int = 0

    @property
    def store_url(self) -> str:
        return f"file://{self.folder / 'store'}"

    def record(self, map_id: str = "hall", *, config: dict[str, Any] | None = None, **told: Any) -> str:
        """Records a build like POST /maps, with the given config or options of the tiny worker."""
        self.count += 1
        (self.folder / "upload").write_bytes(b"a cloud")
        key = f"maps/{map_id}/sources/{put_source(self.catalog.store, map_id, self.folder / 'upload')}"
        build_id = f"b{self.count:03d}"
        self.catalog.builds.put(
            build_id,
            {
                "map_id": map_id,
                "source": {"key": key},
                "file_name": "a.ply",
                "config": config or config_telling(seed=build_id, **told),
            },
        )
        return build_id

    def start_worker(
        self, name: str, *options: str, command: tuple[str, ...] = TINY_WORKER, **environment: str
    ) -> Worker:
        """Starts a build worker as a process, which can be killed."""
        work, port = self.folder / name, free_port()
        arguments = ["worker", "--work", str(work), "--health-port", str(port), *options]
        with (self.folder / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "firstfix_cli.main", *arguments],
                env={
                    **os.environ,
                    "FIRSTFIX_STORE": self.store_url,
                    "FIRSTFIX_BUILD_QUEUE": self.server.url,
                    "FIRSTFIX_BUILD_COMMAND": json.dumps(command),
                    "FIRSTFIX_BUILD_LEASE_S": str(LEASE_S),
                    **self.environment,
                    **environment,
                },
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        worker = Worker(process, work, port)
        self.workers.append(worker)
        return worker

    def start_worker_thread(self, concurrency: int = 1, **changes: Any) -> None:
        """Starts a build worker in a thread of this process: cheaper than a process."""
        given = {
            "store": self.store_url,
            "build_queue": self.server.url,
            "build_command": TINY_WORKER,
            "build_lease_s": LEASE_S,
            "work_dir": self.folder / "worker",
        }
        settings = self.threads.enter_context(changed_constants({**given, **changes}))
        self.threads.enter_context(running_worker(Settings(**settings), concurrency))

    def stop_worker_threads(self) -> None:
        """Stops the build workers in threads, as SIGTERM stops a process."""
        self.threads.close()

    def state(self, build_id: str) -> str:
        return str(self.catalog.builds.status(build_id)["state"])

    def wait_until_in(self, build_id: str, stage: str) -> None:
        def there() -> bool:
            status = self.catalog.builds.status(build_id)
            return (status["state"], status["stage"]) == ("running", stage)

        wait_until(there)

    def wait_until_ended(self, build_id: str) -> dict[str, Any]:
        wait_until(lambda: self.state(build_id) in FINAL_STATES)
        return self.catalog.builds.status(build_id)

    def in_stream(self, stream: str = "FIRSTFIX_BUILDS") -> list[str]:
        """Ids of the builds in a stream."""

        async def ask() -> list[str]:
            import nats

            client = await nats.connect(self.server.url)
            try:
                jetstream = client.jetstream()
                info = await jetstream.stream_info(stream, subjects_filter=">")
                return sorted(subject.rsplit(".", 1)[-1] for subject in info.state.subjects or {})
            finally:
                await client.close()

        return asyncio.run(ask())


@contextmanager
def running_worker(settings: Settings, concurrency: int) -> Iterator[None]:
    stop: list[Callable[[], object]] = []
    started = threading.Event()

    async def run() -> None:
        catalog = Catalog(Store.open(settings.store))
        work = asyncio.create_task(BuildWorker(settings, catalog, Metrics(), concurrency).run())
        loop = asyncio.get_running_loop()
        stop.append(lambda: loop.call_soon_threadsafe(work.cancel))
        started.set()
        with suppress(asyncio.CancelledError):
            await work

    thread = threading.Thread(target=asyncio.run, args=(run(),), daemon=True)
    thread.start()
    assert started.wait(LIMIT_S)
    try:
        yield
    finally:
        stop[0]()
        thread.join(LIMIT_S)
        assert not thread.is_alive(), "the build worker did not stop"


@contextmanager
def nats_world(folder: Path, **options: Any) -> Iterator[NatsWorld]:
    server = NatsServer(folder / "nats", **options)
    server.start()
    world = NatsWorld(folder, server, Catalog(Store.open(f"file://{folder / 'store'}")))
    try:
        with patch.object(nats_queue, "RECONCILE_S", 0.5):  # of queues in this process
            yield world
    finally:
        world.stop_worker_threads()
        for worker in world.workers:
            worker.kill()
        server.stop(signal.SIGKILL)
