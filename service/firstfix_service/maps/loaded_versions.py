"""The versions in memory. They stay within limits of number and bytes; a version in use is never unloaded."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import structlog

from ..query_workers.base import QueryWorkers
from ..query_workers.query import ServedVersion
from ..telemetry.metrics import Metrics
from .eviction_order import EvictionOrder, LoadedVersion
from .version_files import Key, VersionFiles

_log = structlog.get_logger(__name__)
MAX_AHEAD = 16  # versions that are loaded before anybody asks, so that a service with many maps starts soon
ROOM_WITHIN_S = 30.0  # a load waits so long for an unload to end, then it exceeds the limits


class Lease:
    """A version that stays in memory and on the disk until the lease is closed. Close it once.

    Attributes:
        renew: returns another lease of the same version, for another user.
    """

    def __init__(self, served: ServedVersion, close: Callable[[], None], renew: Callable[[], Lease]) -> None:
        self.served = served
        self.close = close
        self.renew = renew


class LoadedVersions:
    """The versions in memory, within limits. Thread-safe.

    The limits count versions in memory, versions that are being loaded and versions that are being unloaded.

    Args:
        must_stay: whether the first version must not be evicted to make room for the second.
        is_protected: whether a version is evicted only if no unprotected one is left.
        on_evict: called for each evicted version.
    """

    def __init__(
        self,
        workers: QueryWorkers,
        metrics: Metrics,
        *,
        max_versions: int,
        max_bytes: int,
        must_stay: Callable[[Key, Key], bool],
        is_protected: Callable[[Key], bool],
        on_evict: Callable[[Key], None],
    ) -> None:
        self._workers = workers
        self._metrics = metrics
        self._max_versions, self._max_bytes = max_versions, max_bytes
        self._must_stay = must_stay
        self._on_evict = on_evict
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._loaded: EvictionOrder = EvictionOrder(is_protected)
        self._leaving: set[LoadedVersion] = set()
        self._leaving_bytes = 0
        self._loading: dict[Key, int] = {}  # to bytes
        self._loading_bytes = 0
        self._line: deque[Key] = deque()  # of loads that wait for room
        self._overcommits = 0
        self._unloader = ThreadPoolExecutor(1, thread_name_prefix="map-unloader")

    def has_room(self, versions: int, size_bytes: int, *, protected: bool) -> bool:
        """Whether so many more versions fit without an eviction.

        Args:
            size_bytes: of these versions together.
            protected: they are protected versions: unprotected ones may be evicted for them, and more than
                ``MAX_AHEAD`` may be loaded.
        """
        with self._changed:
            used, used_bytes = self._used()
            limit = self._max_versions if protected else min(self._max_versions, MAX_AHEAD)
            if protected:
                used -= len(self._loaded) - self._loaded.protected
                used_bytes -= self._loaded.bytes - self._loaded.protected_bytes
            return used + versions <= limit and used_bytes + size_bytes <= self._max_bytes

    @property
    def protected(self) -> int:
        """Number of protected versions in memory."""
        with self._changed:
            return self._loaded.protected

    def reclassify(self) -> None:
        """Ask again which versions are protected."""
        with self._changed:
            self._loaded.reclassify()

    def __contains__(self, key: Key) -> bool:
        with self._changed:
            return key in self._loaded

    def lease(self, key: Key) -> Lease | None:
        """A lease of a version; None if it is not in memory."""
        with self._lock:
            version = self._loaded.use(key)
            return None if version is None else self._lease(version)

    def load(self, files: VersionFiles) -> Lease:
        """Load a version that is not in memory. A version is loaded by one thread only.

        Raises:
            VersionError: see ``QueryWorkers.load``.
        """
        key = files.key
        with self._changed:
            self._wait_for_room(key, files.file_bytes)
            self._loading[key] = files.file_bytes
            self._loading_bytes += files.file_bytes
        try:
            private_bytes = self._workers.load(files.served)
        except BaseException:
            with self._changed:
                self._loading_bytes -= self._loading.pop(key)
                self._changed.notify_all()
            raise
        with self._changed:
            self._loading_bytes -= self._loading.pop(key)
            version = LoadedVersion(files, files.file_bytes + private_bytes)
            self._loaded.add(key, version)
            lease = self._lease(version)
            self._evict_for(key)  # it may take more memory than its files
            self._changed.notify_all()
            self._update_metrics()
        return lease

    def serving_changed(self, key: Key, before: Key | None) -> None:
        """Applies the limits after a version has become the serving one of its map in place of another."""
        with self._changed:
            for one in (before, key):
                if one is not None and one in self._loaded:  # whether it is protected has changed
                    self._loaded.add(one, self._loaded.pop(one))
            self._evict_for(key)
            self._update_metrics()

    def evict(self, key: Key) -> None:
        """Evict a version if it is in memory: it is damaged."""
        with self._changed:
            if key in self._loaded:
                self._evict(key)
                self._update_metrics()

    def begin_overcommit(self) -> None:
        """Allow loads above the limits while a query gathers several versions.

        Without this the query could wait for itself: it may lease the version that would have to be evicted.
        """
        with self._changed:
            self._overcommits += 1
            self._changed.notify_all()

    def end_overcommit(self) -> None:
        """End what ``begin_overcommit`` began."""
        with self._changed:
            self._overcommits -= 1

    def close(self) -> None:
        """Wait until the evicted versions are unloaded."""
        self._unloader.shutdown()

    def _lease(self, version: LoadedVersion) -> Lease:
        version.leases += 1
        return Lease(version.files.served, partial(self._give_back, version), partial(self._renew, version))

    def _renew(self, version: LoadedVersion) -> Lease:
        with self._lock:
            return self._lease(version)

    def _give_back(self, version: LoadedVersion) -> None:
        with self._lock:
            version.leases -= 1
            if version.is_leaving and not version.leases:
                self._unloader.submit(self._unload, version)

    def _wait_for_room(self, key: Key, need_bytes: int) -> None:
        """Wait until a version fits, in the order of the calls; returns if nothing is left to wait for.

        Under the lock.
        """
        self._line.append(key)
        try:
            while True:
                if self._line[0] == key:
                    self._evict_for(key, need_bytes)
                    versions, used_bytes = self._used()
                    fits = versions + 1 <= self._max_versions and used_bytes + need_bytes <= self._max_bytes
                    if fits or not (self._leaving or self._loading):
                        return
                if self._overcommits:
                    return
                if not self._changed.wait(ROOM_WITHIN_S):
                    _log.warning("versions in use exceed the limits of the cache", map_id=key[0])
                    return
        finally:
            self._line.remove(key)
            self._changed.notify_all()

    def _evict_for(self, key: Key, need_bytes: int | None = None) -> None:
        """Evict versions until the others are within the limits, together with one more of ``need_bytes``.

        Under the lock. An evicted version is unloaded as soon as no query uses it.
        """
        more = need_bytes is not None
        while (
            len(self._loaded) + len(self._loading) + more > self._max_versions
            or self._loaded.bytes + self._loading_bytes + (need_bytes or 0) > self._max_bytes
        ):
            candidates = (one for one in self._loaded if one != key and not self._must_stay(one, key))
            candidate = next(candidates, None)
            if candidate is None:
                return
            self._evict(candidate)

    def _evict(self, key: Key) -> None:
        """Evict a version. Under the lock."""
        version = self._loaded.pop(key)
        self._on_evict(key)
        version.is_leaving = True
        self._leaving.add(version)
        self._leaving_bytes += version.bytes
        if not version.leases:
            self._unloader.submit(self._unload, version)

    def _unload(self, version: LoadedVersion) -> None:
        served = version.files.served
        try:
            self._workers.drop(served)
        finally:
            if version.files.folder_lock is not None:
                version.files.folder_lock.close()
            with self._changed:
                self._leaving.discard(version)
                self._leaving_bytes -= version.bytes
                self._changed.notify_all()
        self._metrics.version_evictions.inc()
        _log.info("version evicted", map_id=served.map_id, version=served.version)

    def _used(self) -> tuple[int, int]:
        """Versions and bytes, with those that are being loaded and unloaded."""
        versions = len(self._loaded) + len(self._loading) + len(self._leaving)
        return versions, self._loaded.bytes + self._loading_bytes + self._leaving_bytes

    def _update_metrics(self) -> None:
        self._metrics.versions_loaded.set(len(self._loaded))
        self._metrics.version_bytes.set(self._loaded.bytes)
