"""Runs chunks on the workers of a Dask cluster. The only module that uses Dask."""

from __future__ import annotations

import logging
import os
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from firstfix.builds.shared_stages import SharedStages
from firstfix.errors import BuildCancelled, BuildFailed, ClusterUnavailable, InvalidOption, pip_install
from firstfix.store.store import Store
from firstfix.store.url import StoreUrl

from .chunk_job import ChunkJob, check_runtime, run_job
from .chunks import ChunkBatch, ChunkExecutor, ChunkResults
from .runtime import Runtime, this_runtime

_log = logging.getLogger(__name__)
CONNECT_S = 5.0
CLOSE_S = 2.0
AWAY_S = 120.0  # longest absence of the scheduler, or of all its workers
POLL_S = 0.2
LOOK_S = 5.0  # between looks at the workers
WORK_VARIABLE = "FIRSTFIX_WORK_DIR"


class _SchedulerLost(Exception):
    pass


class DaskExecutor(ChunkExecutor):
    """Runs the chunks of one build on a cluster. As a context manager it closes its connection.

    When a worker dies, Dask gives its chunk to another worker. When the scheduler dies, only the chunks that
    were running are made again: the results in the store stay.

    Args:
        address: of the scheduler, in the form of Dask.
        store_url: of a store that all workers can reach, with their own credentials.
        away_s: longest wait for the scheduler, or a worker, to come back.

    Raises:
        InvalidOption: Dask is not installed, or other machines cannot reach the store.
        ClusterUnavailable: no scheduler, or no worker, within ``away_s``.
        BuildFailed: a worker has other software versions, or does not see the store.
    """

    is_shared = True

    def __init__(self, address: str, store_url: str, *, away_s: float = AWAY_S) -> None:
        check_reachable(store_url)
        where = StoreUrl.parse(store_url)
        self._store_url = str(where.prefix) if where.scheme == "file" else store_url
        self.store = Store.open_at(where)
        self._shared = SharedStages(self.store)
        self._address = address
        self._away_s = away_s
        self._client = self._connect(lambda: False)

    def __enter__(self) -> DaskExecutor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def run(self, batch: ChunkBatch) -> None:
        """Run all chunks of the batch on the cluster's workers.

        Raises:
            ClusterUnavailable: the scheduler, or every worker, stayed away.
        """
        if not batch.chunks:
            return
        for name, result in batch.inputs.items():
            self._shared.put_surely(result.key, name, result.directory)
        keys = {name: result.key for name, result in batch.inputs.items()}
        left = {chunk.key: chunk for chunk in batch.chunks}
        while left:
            jobs = [ChunkJob(self._store_url, chunk, keys, this_runtime()) for chunk in left.values()]
            try:
                for name in self._ended(jobs, batch.cancelled):
                    del left[name]
                    batch.done()
            except _SchedulerLost:
                _log.warning("lost the scheduler at %s, with %d chunks left to run", self._address, len(left))
                self._close()
                self._client = self._connect(batch.cancelled)
                for name in ChunkResults(self.store).made() & left.keys():
                    del left[name]
                    batch.done()

    def _ended(self, jobs: Sequence[ChunkJob], cancelled: Callable[[], bool]) -> Iterator[str]:
        """Yield the key of each chunk when it ends.

        Raises:
            _SchedulerLost: the other chunks have to be handed out again.
        """
        pending: dict[str, Any] = {}
        attempt = uuid.uuid4().hex[:8]
        with _noticing_loss(self._client):
            for job in jobs:
                key = f"{job.chunk.chunk.work}-{attempt}{job.chunk.key[:24]}"
                pending[job.chunk.key] = self._client.submit(_run, job, key=key)
        watch = _Watch(self._client, self._address, self._away_s)
        try:
            while pending:
                if cancelled():
                    raise BuildCancelled("cancelled between the chunks of a stage")
                for name, future in list(pending.items()):
                    if future.status == "error":
                        raise _reason(future)
                    if future.status == "cancelled":
                        raise _SchedulerLost
                    # lost: it ended at a worker that died afterwards. Its result is in the store.
                    if future.status in ("finished", "lost"):
                        del pending[name]
                        yield name
                watch.look()
                time.sleep(POLL_S)
        finally:
            if pending:
                with suppress(Exception):  # the scheduler may be gone
                    self._client.cancel(list(pending.values()))

    def _connect(self, cancelled: Callable[[], bool]) -> Any:
        """A client of a cluster that has workers, all of them fit for this build."""
        try:
            from distributed import Client
        except ImportError:
            raise InvalidOption(f"an executor dask:// needs Dask: {pip_install('.[dask]')}") from None
        end = time.monotonic() + self._away_s
        while True:
            if cancelled():
                raise BuildCancelled("cancelled while the cluster was away")
            try:
                client = Client(self._address, timeout=CONNECT_S, set_as_default=False, name="firstfix")
                break
            except OSError as error:
                if time.monotonic() > end:
                    raise ClusterUnavailable(
                        f"no Dask scheduler answers at {self._address}: {_brief(error)}"
                    ) from None
                time.sleep(1.0)
        try:
            while not client.scheduler_info()["workers"]:
                if cancelled():
                    raise BuildCancelled("cancelled while the cluster had no workers")
                if time.monotonic() > end:
                    raise ClusterUnavailable(f"the Dask scheduler at {self._address} has no workers")
                time.sleep(POLL_S)
            self._check_workers(client)
        except BaseException:
            client.close(timeout=CLOSE_S)
            raise
        return client

    def _check_workers(self, client: Any) -> None:
        key = f"probe/{uuid.uuid4().hex}"
        self.store.put(key, b"seen")
        try:
            found = client.run(_fit, this_runtime(), self._store_url, key, on_error="return")
        finally:
            self.store.delete(key)
        for worker, said in found.items():
            if isinstance(said, OSError):  # this worker has just left; new ones are checked with every chunk
                continue
            if isinstance(said, BuildFailed):
                raise BuildFailed(f"{worker}: {said}")
            if isinstance(said, BaseException):
                raise BuildFailed(f"the worker {worker} cannot build: {_brief(said)}")

    def _close(self) -> None:
        with suppress(Exception):  # the scheduler may be gone
            self._client.close(timeout=CLOSE_S)


class _Watch:
    """Notices that a cluster has had no workers for too long."""

    def __init__(self, client: Any, address: str, away_s: float) -> None:
        self._client = client
        self._address = address
        self._away_s = away_s
        self._looked = self._seen = time.monotonic()

    def look(self) -> None:
        """Check the cluster, at most every few seconds.

        Raises:
            ClusterUnavailable: the cluster has had no workers for too long.
            _SchedulerLost: the scheduler does not answer.
        """
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return
        self._looked = now
        with _noticing_loss(self._client):
            workers = self._client.scheduler_info()["workers"]
        if workers:
            self._seen = now
        elif now - self._seen > self._away_s:
            raise ClusterUnavailable(f"the Dask scheduler at {self._address} has lost all its workers")


@contextmanager
def _noticing_loss(client: Any) -> Iterator[None]:
    """Raise _SchedulerLost for each of the errors by which Dask reports a lost scheduler."""
    try:
        yield
    except Exception as error:
        if isinstance(error, OSError) or client.status != "running":
            raise _SchedulerLost from error
        raise


def _reason(future: Any) -> BaseException:
    from distributed import KilledWorker

    error: BaseException = future.exception()
    if isinstance(error, KilledWorker):
        return BuildFailed("every worker that ran a certain chunk died, maybe out of memory")
    return error


def _run(job: ChunkJob) -> None:
    """Run a job. Called on a worker."""
    from distributed import get_worker

    folder = Path(os.environ.get(WORK_VARIABLE) or get_worker().local_directory) / "cluster"
    run_job(job, folder)


def _fit(wanted: Runtime, store_url: str, key: str) -> None:
    """Check whether a worker can take part. Called on the worker."""
    check_runtime(wanted)
    if not Store.open(store_url).exists(key):
        raise BuildFailed("it sees another store than this build: all machines must share the directory")


def _brief(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).split("\n", 1)[0][:300]


def check_reachable(store_url: str) -> None:
    """Check that other machines can reach a store.

    Raises:
        InvalidOption: it is in the memory of this process.
    """
    if StoreUrl.parse(store_url).scheme == "memory":
        raise InvalidOption("workers of a cluster cannot share a store in memory")
