"""A real Dask cluster on loopback: scheduler and workers as processes that can be killed one by one."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tests.servers import free_port
from tests.waiting import wait_until

PATIENCE_S = 300.0  # a busy machine starts a worker slowly
_ROOT = Path(__file__).resolve().parents[3]


class DaskCluster:
    """A scheduler and workers of Dask, each a process.

    Args:
        folder: of logs and workers' files.
        path: folders that workers import from besides the checkout's.
        tls: PEM files of an authority, and of certificate and key; None: unencrypted.

    Attributes:
        url: as ``--executor`` takes it.
        address: as Dask does.
    """

    def __init__(
        self, folder: Path, path: tuple[Path, ...] = (), tls: tuple[Path, Path] | None = None
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._path = (_ROOT / "core", _ROOT / "builder", *path)
        self._port = free_port()  # its own also while no scheduler runs: one is started again
        self._scheduler: subprocess.Popen[bytes] | None = None
        self._started = 0
        self.workers: list[subprocess.Popen[bytes]] = []
        self._secured: tuple[str, ...] = ()
        if tls is not None:
            ca, pair = map(str, tls)
            self._secured = ("--tls-ca-file", ca, "--tls-cert", pair, "--tls-key", pair, "--protocol", "tls")
        self.url = f"dask{'' if tls is None else '+tls'}://127.0.0.1:{self._port}"
        self.address = f"{'tcp' if tls is None else 'tls'}://127.0.0.1:{self._port}"

    def start_scheduler(self, environment: Mapping[str, str] | None = None) -> None:
        """Starts the scheduler, always at the same address.

        Args:
            environment: beside this process's own: Dask's configuration.
        """
        place = ("--host", "127.0.0.1", "--port", str(self._port), "--dashboard-address", "127.0.0.1:0")
        self._scheduler = self._start(environment or {}, "scheduler", *place, *self._secured)

    def start_worker(self, *path: Path) -> subprocess.Popen[bytes]:
        """Starts one more worker.

        Args:
            path: folders to import from before all others.
        """
        self._started += 1
        place = ("--local-directory", str(self._folder / f"worker-{self._started}"))
        options = ("--nthreads", "1", "--no-nanny", "--dashboard-address", "127.0.0.1:0")
        options += ("--death-timeout", "60", *self._secured)
        worker = self._start({}, "worker", self.address, *options, *place, path=path)
        self.workers.append(worker)
        return worker

    def kill_worker(self, worker: subprocess.Popen[bytes]) -> None:
        worker.kill()
        worker.wait()
        self.workers.remove(worker)

    def kill_scheduler(self) -> None:
        """Kills the scheduler and the workers, which would end without it."""
        self.stop()
        self.workers.clear()

    def stop(self) -> None:
        for process in (*self.workers, self._scheduler):
            if process is not None:
                process.kill()
                process.wait()

    def log(self) -> str:
        return (self._folder / "log").read_text()

    def wait_for_scheduler(self) -> None:
        wait_until(lambda: "Scheduler at:" in self.log())

    def wait_for_workers(self, count: int, seconds: float = PATIENCE_S) -> None:
        """Until so many have come, since the cluster began."""
        wait_until(lambda: self.log().count("Register worker addr") >= count, seconds)

    def _start(
        self,
        environment: Mapping[str, str],
        *command: str,
        path: tuple[Path, ...] = (),
    ) -> subprocess.Popen[bytes]:
        folders = [*map(str, path), *map(str, self._path), os.environ.get("PYTHONPATH", "")]
        whole = {
            **os.environ,
            **environment,
            "PYTHONPATH": os.pathsep.join(folders),
            "OPENBLAS_NUM_THREADS": "1",
        }
        with (self._folder / "log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *command], stdout=log, stderr=log, env=whole
            )


@contextmanager
def dask_cluster(
    folder: Path,
    workers: int,
    *,
    path: tuple[Path, ...] = (),
    environment: Mapping[str, str] | None = None,
    tls: tuple[Path, Path] | None = None,
) -> Iterator[DaskCluster]:
    """One that is running, with so many workers on their way."""
    cluster = DaskCluster(folder, path, tls)
    try:
        cluster.start_scheduler(environment)
        for _ in range(workers):
            cluster.start_worker()
        yield cluster
    finally:
        cluster.stop()
