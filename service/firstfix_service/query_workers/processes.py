"""Worker processes for queries: they share no interpreter lock, and one that dies loses only its own query.

The service decides which versions are loaded. A process that replaces a dead one loads them at once. A query
that comes earlier loads the versions that it needs.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial

import structlog

from firstfix.errors import FirstfixError, VersionError

from .base import QueryWorker, QueryWorkerDied
from .handle import QueryWorkerDefect, QueryWorkerHandle
from .query import ServedVersion
from .sightings.counter import Sighted

_log = structlog.get_logger(__name__)
LOAD_ATTEMPTS = 2
MAX_WARM_UPS = 8  # of the versions that a replaced process loads: the latest
QUERY_TIMEOUT_S = 30.0  # the hardest queries take a few seconds: one that takes longer hangs
BORN_WITHIN_S = 30.0  # for a process to replace one that died
SHORT_LIFE_S, PAUSE_S = 5.0, 1.0  # after such a short life the next process waits for the pause


class QueryWorkerProcesses:
    """A fixed number of worker processes. Each is replaced when it dies.

    Args:
        on_up: called with each process that can answer, in another thread.
        query_timeout_s: a query that runs longer fails, and its process is replaced.
        max_body_bytes: largest body of a query, with and without its content encoding.
        counts_sightings: of localized queries.
        on_death: called when a process dies unexpectedly.
    """

    def __init__(
        self,
        count: int,
        *,
        on_up: Callable[[QueryWorker], None],
        query_timeout_s: float,
        max_body_bytes: int,
        counts_sightings: bool = False,
        on_death: Callable[[], None] = lambda: None,
    ) -> None:
        self._start = partial(
            QueryWorkerHandle, query_timeout_s, max_body_bytes, counts_sightings=counts_sightings
        )
        self._counts_sightings = counts_sightings
        self._on_up, self._on_death = on_up, on_death
        self._lock = threading.RLock()
        self._born = threading.Condition(self._lock)
        self._closing = threading.Event()
        self._versions: dict[ServedVersion, None] = {}  # loaded, in that order
        self._living: dict[QueryWorkerHandle, None] = {}
        self._loaders = ThreadPoolExecutor(count, thread_name_prefix="worker-load")
        self._keepers = [
            threading.Thread(target=self._keep_one, name=f"worker-{k}", daemon=True) for k in range(count)
        ]
        for keeper in self._keepers:
            keeper.start()

    @property
    def pids(self) -> list[int]:
        """Process ids of the living workers."""
        with self._lock:
            return [worker.pid for worker in self._living]

    def load(self, version: ServedVersion) -> int:
        """Load a version in one process first: if it kills that one, the others never see it."""
        first, private = self._load_in_one(version)
        with self._lock:
            self._versions[version] = None  # processes that start from now on load it too
            others = [worker for worker in self._living if worker is not first]
        return private + sum(self._loaders.map(partial(_load_if_alive, version), others))

    def warm_up(self, version: ServedVersion) -> int:
        """Warms up one process after the other, so that the others are free for queries meanwhile."""
        with self._lock:
            living = list(self._living)
        return sum(worker.warm_up(version) for worker in living if worker.is_alive)

    def _load_in_one(self, version: ServedVersion) -> tuple[QueryWorkerHandle, int]:
        tried: list[QueryWorkerHandle] = []
        for _ in range(LOAD_ATTEMPTS):
            with self._lock:
                self._born.wait_for(
                    lambda: self._closing.is_set() or self._living.keys() - set(tried), BORN_WITHIN_S
                )
                untried = [worker for worker in self._living if worker not in tried]
            if not untried:
                break
            tried.append(untried[0])
            try:
                return untried[0], untried[0].load(version)
            except QueryWorkerDied:
                continue
            except QueryWorkerDefect as error:
                raise VersionError(f"version {version.version} cannot be loaded: {error}") from None
        raise VersionError(f"worker processes died while they loaded version {version.version}")

    def drop(self, version: ServedVersion) -> None:
        """Unload a version in every process."""
        with self._lock:
            self._versions.pop(version, None)
            living = list(self._living)
        for worker in living:
            worker.drop(version)

    def take_sightings(self) -> list[Sighted]:
        """Counts of the living processes. Those that a dead one had not given are lost."""
        with self._lock:
            living = list(self._living)
        return [worker.take_sightings() for worker in living] if self._counts_sightings else []

    def close(self) -> None:
        """End the processes. Call it when no query runs."""
        with self._lock:
            self._closing.set()
            self._born.notify_all()
            living = list(self._living)
        for worker in living:
            worker.kill()
        for keeper in self._keepers:
            keeper.join()
        self._loaders.shutdown()

    def _keep_one(self) -> None:
        """Keep one process running: starts another one when it dies."""
        while not self._closing.is_set():
            try:
                worker = self._start()
            except OSError as error:  # no memory, or too many processes
                _log.error("no worker process could be started", error=str(error))
                self._closing.wait(PAUSE_S)
                continue
            with self._lock:
                self._living[worker] = None
                versions = list(reversed(self._versions))  # the latest first
                self._born.notify_all()
            if self._closing.is_set():
                worker.kill()
            with suppress(QueryWorkerDied):
                worker.wait_until_up()
                self._on_up(worker)
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

    def _load_again(self, worker: QueryWorkerHandle, versions: list[ServedVersion]) -> None:
        for number, version in enumerate(versions):
            with self._lock:
                wanted = version in self._versions
            if wanted:
                try:
                    worker.load(version)
                    if number < MAX_WARM_UPS:
                        worker.warm_up(version)
                except (FirstfixError, QueryWorkerDefect) as error:  # a query that needs it reports it too
                    _log.warning(
                        "not ready in a new worker process", version=version.version, error=str(error)
                    )


def _load_if_alive(version: ServedVersion, worker: QueryWorkerHandle) -> int:
    """Load a version that another process could load. The next query reports an error of this one."""
    try:
        return worker.load(version)
    except (QueryWorkerDied, FirstfixError, QueryWorkerDefect) as error:
        _log.warning("not loaded in a worker process", version=version.version, error=str(error))
        return 0
