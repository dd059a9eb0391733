"""Loads a version, once for all who ask: fetches it from the store, verifies it, and refuses a bad one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.versions.cache import check_again
from firstfix.catalog.versions.folder_lock import FolderLock
from firstfix.catalog.versions.prune import prune
from firstfix.errors import CorruptVersion, NotFound, StoreError, VersionError

from ..query_workers.query import ServedVersion
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import current_caller
from ..thread_pools import ThreadPool
from .loaded_versions import Lease, LoadedVersions
from .version_files import Key, VersionFiles

_log = structlog.get_logger(__name__)
LOADERS = 8  # loads at the same time: a slow one does not delay the others
Wanted = tuple[str, str | None]  # a map and its version; None: the active one
REFUSED_FOR_S = 60.0  # a refused version is read again after this time: it may have been repaired
# Pruning the disk looks at every version there. So it is done only after so many bytes were fetched.
PRUNE_SHARE = 100  # part of the limit
CHECK_EVERY_S = 600.0
PRUNE_EVERY_S = 600.0  # for versions that other processes left


@dataclass(frozen=True)
class _Refusal:
    error: VersionError
    until: float  # time.monotonic


class VersionLoader:
    """Loads versions, each once however many threads ask. Thread-safe.

    Args:
        directory: folder of fetched versions. Those not in use are kept there up to ``max_disk_bytes``, and
            one hundredth more for a short time.
    """

    def __init__(
        self,
        catalog: Catalog,
        loaded: LoadedVersions,
        metrics: Metrics,
        directory: Path,
        *,
        max_disk_bytes: int,
    ) -> None:
        self._catalog = catalog
        self._loaded = loaded
        self._metrics = metrics
        self._directory = directory
        self._max_disk_bytes = max_disk_bytes
        self._lock = threading.Lock()
        self._under_way: dict[Key, Future[None]] = {}
        self._refused: dict[Key, _Refusal] = {}
        self._checked: dict[Key, float] = {}  # time.monotonic of the last check after a failed query
        self._fetched_bytes = 0  # since the last prune
        self._pruned_at = -PRUNE_EVERY_S

    def load(self, map_id: str, version: str) -> Lease:
        """A lease of a version, which is loaded if it is not in memory.

        Raises:
            NotFound: there is no such version.
            VersionError: the version cannot be served.
            StoreError: the store failed.
        """
        key = (map_id, version)
        while True:
            lease = self._loaded.lease(key)
            if lease is not None:
                return lease
            with self._lock:
                refusal = self._refused.get(key)
                if refusal is not None and time.monotonic() < refusal.until:
                    raise refusal.error
                others = self._under_way.get(key)
                if others is None:
                    ours = self._under_way[key] = Future()
            if others is not None:
                others.result()
                continue
            try:
                lease = self._fetch_and_load(map_id, version)
            except BaseException as error:
                ours.set_exception(error)
                raise
            else:
                ours.set_result(None)
                return lease
            finally:
                with self._lock:
                    del self._under_way[key]

    def check_files(self, served: ServedVersion) -> None:
        """Read the files of a loaded version again, because a query failed on them.

        They may be large, so this is done once in ``CHECK_EVERY_S``. A damaged version is evicted. One in a
        file store is then refused, another one is fetched again.

        Raises:
            CorruptVersion: a file is missing or damaged.
        """
        key = (served.map_id, served.version)
        with self._lock:
            now = time.monotonic()
            if now - self._checked.get(key, -CHECK_EVERY_S) < CHECK_EVERY_S:
                return
            self._checked[key] = now
        try:
            with suppress(NotFound, StoreError):  # retired meanwhile, or nobody can tell now
                manifest = self._catalog.manifest(served.map_id, served.version)
                check_again(manifest, served.directory, self._directory)
        except CorruptVersion as error:
            with self._lock:
                self._checked.pop(key, None)
            if served.directory.parent != self._directory:
                self._refuse(served.map_id, served.version, error)
            self._loaded.evict(key)
            raise

    def _fetch_and_load(self, map_id: str, version: str) -> Lease:
        start = time.perf_counter()
        files = None
        try:
            files = self._fetch(map_id, version)
            lease = self._loaded.load(files)
        except BaseException as error:
            if files is not None and files.folder_lock is not None:
                files.folder_lock.close()
            if isinstance(error, VersionError):
                self._refuse(map_id, version, error)
            raise
        with self._lock:
            self._refused.pop((map_id, version), None)
        seconds = time.perf_counter() - start
        self._metrics.version_loads.labels("ok").inc()
        self._metrics.load_seconds.observe(seconds)
        _log.info("version loaded", map_id=map_id, version=version, seconds=round(seconds, 3))
        if self._is_time_to_prune(0 if files.folder_lock is None else files.file_bytes):
            for removed in prune(self._directory, self._max_disk_bytes):
                _log.info("version removed from the disk", version=removed)
        return lease

    def _is_time_to_prune(self, fetched_bytes: int) -> bool:
        with self._lock:
            self._fetched_bytes += fetched_bytes
            is_due = self._fetched_bytes >= self._max_disk_bytes // PRUNE_SHARE
            is_due |= time.monotonic() - self._pruned_at >= PRUNE_EVERY_S
            if is_due:
                self._fetched_bytes, self._pruned_at = 0, time.monotonic()
            return is_due

    def _fetch(self, map_id: str, version: str) -> VersionFiles:
        manifest = self._catalog.manifest(map_id, version)
        while True:
            directory = self._catalog.fetch_version(map_id, version, self._directory)
            served = ServedVersion(map_id, version, directory, manifest.provisional)
            if directory.parent != self._directory:  # the file store's own folder
                return VersionFiles(served, manifest.query_bytes, None)
            try:
                return VersionFiles(served, manifest.query_bytes, FolderLock(directory))
            except FileNotFoundError:  # another process has just pruned it
                continue

    def _refuse(self, map_id: str, version: str, error: VersionError) -> None:
        with self._lock:
            self._refused[(map_id, version)] = _Refusal(error, time.monotonic() + REFUSED_FOR_S)
        self._metrics.version_loads.labels(error.code).inc()
        _log.error("version refused", map_id=map_id, version=version, code=error.code, error=str(error))


@dataclass
class _SharedLoad:
    """One load.

    Attributes:
        waiting: for its lease.
        callers: in whose turns it may begin: whichever comes first.
    """

    waiting: list[Future[Lease]] = field(default_factory=list)
    callers: set[str] = field(default_factory=set)
    has_begun: bool = False


class SharedLoads:
    """Loads that queries wait for; callers take turns. Thread-safe.

    Args:
        load: loads a version of a map; None means its active version.
    """

    def __init__(self, load: Callable[[str, str | None], Lease]) -> None:
        self._load = load
        self._lock = threading.Lock()
        self._loads: dict[Wanted, _SharedLoad] = {}
        self._pool = ThreadPool("map-loader", LOADERS)

    def request(self, map_id: str, version: str | None) -> Future[Lease]:
        """A future of a lease. The first caller whose turn comes begins the load."""
        future: Future[Lease] = Future()
        wanted, caller = (map_id, version), current_caller()
        with self._lock:
            shared = self._loads.setdefault(wanted, _SharedLoad())
            shared.waiting.append(future)
            is_queued = shared.has_begun or caller in shared.callers
            shared.callers.add(caller)
        if not is_queued:
            self._pool.submit(caller, self._run, wanted, shared)
        return future

    def close(self) -> None:
        """Wait for the loads that have begun; the others are cancelled."""
        self._pool.close()

    def _run(self, wanted: Wanted, shared: _SharedLoad) -> None:
        with self._lock:
            if shared.has_begun:  # in the turn of another caller
                return
            shared.has_begun = True
        try:
            lease = self._load(*wanted)
        except BaseException as error:
            for future in self._take_waiting(wanted):
                future.set_exception(error)
            return
        for future in self._take_waiting(wanted):
            future.set_result(lease.renew())
        lease.close()

    def _take_waiting(self, wanted: Wanted) -> list[Future[Lease]]:
        with self._lock:
            return self._loads.pop(wanted).waiting
