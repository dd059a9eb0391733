"""Queries in processes of their own: they do not share one interpreter's lock, and one that dies takes
nothing but its own query along.

What is loaded is decided in the service. A process that takes the place of one that died is told at once
what there is to load; a query that comes before that loads what it needs itself.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial

import structlog

from firstfix.answer.localization import Localization
from firstfix.errors import DeadlineExceeded, FirstfixError, VersionError, WorkerLost

from .handle import WorkerDefect, WorkerDied, WorkerHandle, WorkerStuck
from .query import Query, ServedVersion

_log = structlog.get_logger(__name__)
ATTEMPTS = 2
FREE_WITHIN_S = 30.0  # for a process to take the place of one that died
SHORT_LIFE_S, PAUSE_S = 5.0, 1.0  # after a process that died so young the next one has to wait


class ProcessWorkers:
    """As many processes as asked for, each replaced when it dies.

    Args:
        query_timeout_s: a query that runs longer is given up, and its process replaced.
        on_death: called when one has died that was not told to.
    """

    def __init__(
        self, count: int, *, query_timeout_s: float, on_death: Callable[[], None] = lambda: None
    ) -> None:
        self._query_timeout_s = query_timeout_s
        self._on_death = on_death
        self._lock = threading.RLock()
        self._born = threading.Condition(self._lock)
        self._closing = threading.Event()
        self._versions: dict[ServedVersion, None] = {}  # loaded, in that order
        self._living: dict[WorkerHandle, None] = {}
        self._idle: queue.LifoQueue[WorkerHandle] = queue.LifoQueue()
        self._loaders = ThreadPoolExecutor(count, thread_name_prefix="worker-load")
        self._keepers = [
            threading.Thread(target=self._keep_one, name=f"worker-{k}", daemon=True) for k in range(count)
        ]
        for keeper in self._keepers:
            keeper.start()

    @property
    def pids(self) -> list[int]:
        with self._lock:
            return [worker.pid for worker in self._living]

    def load(self, version: ServedVersion) -> int:
        """One process goes first: a version that kills it is refused before it reaches the others."""
        first, private = self._load_in_one(version)
        with self._lock:
            self._versions[version] = None  # a process that starts from now on loads it too
            others = [worker for worker in self._living if worker is not first]
        return private + sum(self._loaders.map(partial(_load_if_alive, version), others))

    def _load_in_one(self, version: ServedVersion) -> tuple[WorkerHandle, int]:
        tried: list[WorkerHandle] = []
        for _ in range(ATTEMPTS):
            with self._lock:
                self._born.wait_for(
                    lambda: self._closing.is_set() or self._living.keys() - set(tried), FREE_WITHIN_S
                )
                untried = [worker for worker in self._living if worker not in tried]
            if not untried:
                break
            tried.append(untried[0])
            try:
                return untried[0], untried[0].load(version)
            except WorkerDied:
                continue
            except WorkerDefect as error:
                raise VersionError(f"version {version.version} cannot be loaded: {error}") from None
        raise VersionError(f"worker processes died while they loaded version {version.version}")

    def drop(self, version: ServedVersion) -> None:
        with self._lock:
            self._versions.pop(version, None)
            living = list(self._living)
        for worker in living:
            worker.drop(version)

    def answer(self, query: Query) -> Localization:
        for _ in range(ATTEMPTS):
            worker = self._free_one()
            try:
                answer = worker.answer(query, self._query_timeout_s)
            except WorkerDied:
                continue  # its keeper puts another in its place
            except WorkerStuck as error:
                raise DeadlineExceeded(f"the query was given up: it ran for {error}") from None
            except (FirstfixError, WorkerDefect):
                self._idle.put(worker)
                raise
            self._idle.put(worker)
            return answer
        raise WorkerLost("the process that had the query died, and so did the next one")

    def close(self) -> None:
        """Ends the processes; call it when no query runs."""
        with self._lock:
            self._closing.set()
            self._born.notify_all()
            living = list(self._living)
        for worker in living:
            worker.kill()
        for keeper in self._keepers:
            keeper.join()
        self._loaders.shutdown()

    def _free_one(self) -> WorkerHandle:
        """
        Raises:
            WorkerLost: none in time.
        """
        end = time.monotonic() + FREE_WITHIN_S
        while True:
            try:
                worker = self._idle.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                raise WorkerLost("no worker process is up: try again") from None
            with self._lock:
                if worker in self._living:
                    return worker

    def _keep_one(self) -> None:
        """The life of one place: a process, and another when it has died."""
        while not self._closing.is_set():
            try:
                worker = WorkerHandle()
            except OSError as error:  # no memory or no process to be had
                _log.error("no worker process could be started", error=str(error))
                self._closing.wait(PAUSE_S)
                continue
            with self._lock:
                self._living[worker] = None
                versions = list(reversed(self._versions))  # the latest first
                self._born.notify_all()
            if self._closing.is_set():
                worker.kill()
            with suppress(WorkerDied):
                worker.wait_until_up()
                self._idle.put(worker)
                self._load_again(worker, versions)
            status = worker.wait()
            with self._lock:
                del self._living[worker]
            worker.close()
            if not self._closing.is_set():
                lived_s = time.monotonic() - worker.started
                _log.error("a worker process died", pid=worker.pid, status=status, lived_s=round(lived_s, 1))
                self._on_death()
                if lived_s < SHORT_LIFE_S:
                    self._closing.wait(PAUSE_S)

    def _load_again(self, worker: WorkerHandle, versions: list[ServedVersion]) -> None:
        for version in versions:
            with self._lock:
                wanted = version in self._versions
            if wanted:
                with suppress(FirstfixError, WorkerDefect):  # a query that needs it will say so
                    worker.load(version)


def _load_if_alive(version: ServedVersion, worker: WorkerHandle) -> int:
    """It was loaded elsewhere: what goes wrong here is trouble of this process, told by the next query."""
    try:
        return worker.load(version)
    except (WorkerDied, FirstfixError, WorkerDefect) as error:
        _log.warning("not loaded in a worker process", version=version.version, error=str(error))
        return 0
