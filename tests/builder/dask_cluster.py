"""A real Dask cluster for tests: scheduler and workers as processes that can be killed one by one."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from servers import free_port

_ROOT = Path(__file__).resolve().parents[2]
_PATH = [str(_ROOT / part) for part in ("core", "builder", "tests", "tests/builder")]


class DaskCluster:
    """Attributes:
    url: as ``--executor`` takes it.
    address: as Dask does.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._port = free_port()
        self._scheduler: subprocess.Popen[bytes] | None = None
        self._workers: list[subprocess.Popen[bytes]] = []
        self.url = f"dask://127.0.0.1:{self._port}"
        self.address = f"tcp://127.0.0.1:{self._port}"

    def start_scheduler(self) -> None:
        options = ("--host", "127.0.0.1", "--port", str(self._port), "--no-dashboard", "--no-show")
        self._scheduler = self._start("scheduler", *options)

    def start_worker(self, *path: Path) -> subprocess.Popen[bytes]:
        """
        Args:
            path: folders to import from before all others.
        """
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--death-timeout", "20")
        place = ("--local-directory", str(self._folder / f"worker-{len(self._workers)}"))
        worker = self._start("worker", self.address, *options, *place, path=path)
        self._workers.append(worker)
        return worker

    def kill_worker(self, worker: subprocess.Popen[bytes]) -> None:
        worker.kill()
        worker.wait()
        self._workers.remove(worker)

    def kill_scheduler(self) -> None:
        """The workers end without it."""
        assert self._scheduler is not None
        self._scheduler.kill()
        self._scheduler.wait()
        for worker in self._workers:
            worker.kill()
            worker.wait()
        self._workers.clear()

    def stop(self) -> None:
        for process in (*self._workers, self._scheduler):
            if process is not None:
                process.kill()
                process.wait()

    def log(self) -> str:
        return (self._folder / "log").read_text()

    def _start(self, *command: str, path: tuple[Path, ...] = ()) -> subprocess.Popen[bytes]:
        self._folder.mkdir(parents=True, exist_ok=True)
        folders = [*map(str, path), *_PATH, os.environ.get("PYTHONPATH", "")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders), "OPENBLAS_NUM_THREADS": "1"}
        with (self._folder / "log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *command], stdout=log, stderr=log, env=environment
            )


@contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[DaskCluster]:
    cluster = DaskCluster(folder)
    try:
        cluster.start_scheduler()
        for _ in range(workers):
            cluster.start_worker()
        yield cluster
    finally:
        cluster.stop()


def wait_until(condition, seconds: float = 30.0) -> None:  # type: ignore[no-untyped-def]
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing of the kind happened"
        time.sleep(0.02)
