"""A version from the store into memory: fetched, verified, loaded, once however many ask; or refused."""

from __future__ import annotations

import threading
import time
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.versions.cache import HeldFolder
from firstfix.catalog.versions.prune import prune
from firstfix.errors import VersionError

from ..query_workers.query import ServedVersion
from ..telemetry.metrics import Metrics
from .eviction_order import Key
from .loaded_versions import Lease, ResidentVersions, VersionFiles

_log = structlog.get_logger(__name__)
REFUSED_FOR_S = 60.0  # a version that was found bad is read again after this: somebody may have mended it
# Making room on the disk looks at every version there: it is done when so much may have come as would matter.
PRUNE_SHARE = 100  # part of the limit
PRUNE_EVERY_S = 600.0  # for what was left by others


@dataclass(frozen=True)
class _Refusal:
    error: VersionError
    until: float


class VersionLoader:
    """Thread-safe.

    Args:
        directory: versions that were fetched; up to ``max_disk_bytes`` of those not in use stay there, and a
            hundredth of that for a moment.
    """

    def __init__(
        self,
        catalog: Catalog,
        resident: ResidentVersions,
        metrics: Metrics,
        directory: Path,
        *,
        max_disk_bytes: int,
    ) -> None:
        self._catalog = catalog
        self._resident = resident
        self._metrics = metrics
        self._directory = directory
        self._max_disk_bytes = max_disk_bytes
        self._lock = threading.Lock()
        self._under_way: dict[Key, Future[None]] = {}
        self._refused: dict[Key, _Refusal] = {}
        self._fetched_bytes = 0  # since room was made
        self._pruned_at = -PRUNE_EVERY_S

    def load(self, map_id: str, version: str) -> Lease:
        """
        Raises:
            NotFound: no such version.
            VersionError: it cannot be served.
            StoreError: the store failed.
        """
        key = (map_id, version)
        while True:
            lease = self._resident.lease(key)
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

    def _fetch_and_load(self, map_id: str, version: str) -> Lease:
        start = time.perf_counter()
        files = None
        try:
            files = self._fetch(map_id, version)
            lease = self._resident.load(files)
        except BaseException as error:
            if files is not None and files.hold is not None:
                files.hold.close()
            if isinstance(error, VersionError):
                self._refuse(map_id, version, error)
            raise
        with self._lock:
            self._refused.pop((map_id, version), None)
        seconds = time.perf_counter() - start
        self._metrics.version_loads.labels("ok").inc()
        self._metrics.load_seconds.observe(seconds)
        _log.info("version loaded", map_id=map_id, version=version, seconds=round(seconds, 3))
        if self._is_time_to_prune(0 if files.hold is None else files.file_bytes):
            for gone in prune(self._directory, self._max_disk_bytes):
                _log.info("version taken off the disk", version=gone)
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
            served = ServedVersion(map_id, version, directory)
            if directory.parent != self._directory:  # a file store's own
                return VersionFiles(served, manifest.total_bytes, None)
            try:
                return VersionFiles(served, manifest.total_bytes, HeldFolder(directory))
            except FileNotFoundError:  # another process made room meanwhile
                continue

    def _refuse(self, map_id: str, version: str, error: VersionError) -> None:
        with self._lock:
            self._refused[(map_id, version)] = _Refusal(error, time.monotonic() + REFUSED_FOR_S)
        self._metrics.version_loads.labels(error.code).inc()
        _log.error("version refused", map_id=map_id, version=version, code=error.code, error=str(error))
