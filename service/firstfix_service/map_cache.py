"""The map versions in memory: loaded on demand, swapped when another is activated, never for a bad one."""

from __future__ import annotations

import shutil
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import structlog

from firstfix.any_scan import AnyScan
from firstfix.catalog import Catalog
from firstfix.errors import FirstfixError, NotFound, VersionError
from firstfix.ids import check_map_id, check_version
from firstfix.localization import Localization
from firstfix.localizer import FindsPlaces, Localizer
from firstfix.map_index import MapIndex
from firstfix.options import LocalizeOptions

from .metrics import Metrics

_log = structlog.get_logger(__name__)
REFUSED_FOR_S = 60.0  # a version that was found bad is read again after this: somebody may have mended it


class LocalizesScans(FindsPlaces, Protocol):
    def localize(self, scan: AnyScan, options: LocalizeOptions | None = None) -> Localization: ...


@dataclass(frozen=True)
class ServedVersion:
    """One version, ready to answer."""

    map_id: str
    version: str
    localizer: LocalizesScans
    directory: Path
    file_bytes: int


@dataclass(frozen=True)
class _Refusal:
    error: VersionError
    until: float


_Key = tuple[str, str]  # map id, version


def load_localizer(directory: Path) -> LocalizesScans:
    return Localizer(MapIndex.load(directory))


class MapCache:
    """Versions by map, least recently used out first. Thread-safe.

    A query holds its ``ServedVersion`` by reference, so a version that is swapped or put out still answers
    the queries that it began.
    """

    def __init__(
        self,
        catalog: Catalog,
        directory: Path,
        metrics: Metrics,
        *,
        max_versions: int,
        max_bytes: int,
        load: Callable[[Path], LocalizesScans] = load_localizer,
    ) -> None:
        self._catalog = catalog
        self._directory = directory
        self._metrics = metrics
        self._max_versions, self._max_bytes = max_versions, max_bytes
        self._load_files = load
        self._lock = threading.Lock()
        self._loaded: OrderedDict[_Key, ServedVersion] = OrderedDict()
        self._serving: dict[str, str] = {}  # map id -> version that answers when none is named
        self._behind: set[str] = set()  # maps whose active version was refused
        self._tried: set[str] = set()  # maps that the poll has loaded ahead of their first query, or not
        self._load_locks: dict[_Key, threading.Lock] = {}
        self._refused: dict[_Key, _Refusal] = {}
        self.map_ids: tuple[str, ...] = ()  # of the last poll
        self.polled = False

    def get(self, map_id: str, version: str | None = None) -> ServedVersion:
        """A version to answer from: the named one, else the map's active one. Loads it if need be.

        Raises:
            NotFound: no such map or version.
            VersionError: it cannot be served, nor can one that was active before.
            StoreError: the store failed.
        """
        check_map_id(map_id)
        if version is not None:
            check_version(version)
            with self._lock:
                loaded = (map_id, version) in self._loaded
            self._metrics.cache_lookups.labels("hit" if loaded else "miss").inc()
            return self._load(map_id, version)
        with self._lock:
            key = (map_id, self._serving.get(map_id, ""))
            if key in self._loaded:
                self._loaded.move_to_end(key)
                self._metrics.cache_lookups.labels("hit").inc()
                return self._loaded[key]
        self._metrics.cache_lookups.labels("miss").inc()
        return self.refresh(map_id)

    def refresh(self, map_id: str) -> ServedVersion:
        """Reads the map's log and serves what it says: the active version, or when that one is refused the
        one that was active before, as a replica that never stopped would.

        Raises:
            as ``get``.
        """
        state = self._catalog.state(map_id)
        if not state.activated:
            self._forget(map_id)
            what = f"map {map_id} has no active version" if state.published else f"no map {map_id}"
            raise NotFound(what)
        first_error: VersionError | None = None
        for version in state.activated:
            try:
                served = self._load(map_id, version)
            except VersionError as error:
                first_error = first_error or error
                continue
            self._serve(map_id, version, is_active=version == state.active)
            return served
        assert first_error is not None
        raise first_error

    def poll(self) -> None:
        """Looks for maps and activations that are new. What cannot be read stays as it is."""
        map_ids = self._catalog.map_ids()
        for map_id in set(self._serving) - set(map_ids):
            self._forget(map_id)
        for map_id in map_ids:
            try:
                if self._is_due(map_id):
                    self.refresh(map_id)
            except FirstfixError as error:
                _log.warning("cannot serve", map_id=map_id, code=error.code, error=str(error))
        self.map_ids = tuple(map_ids)
        self.polled = True

    def _is_due(self, map_id: str) -> bool:
        """Whether the poll has to see to a map: it answers and another version is active now, or it was
        never asked for and there is room. One that was put out comes back with its next query."""
        with self._lock:
            serving = self._serving.get(map_id)
            if serving is not None and (map_id, serving) in self._loaded:
                behind = map_id in self._behind
            elif map_id in self._tried:
                return False
            else:
                self._tried.add(map_id)
                return len(self._loaded) < self._max_versions and self._bytes() < self._max_bytes
        return behind or self._catalog.active_version(map_id) != serving

    def _serve(self, map_id: str, version: str, *, is_active: bool) -> None:
        with self._lock:
            changed = self._serving.get(map_id) != version
            self._serving[map_id] = version
            (self._behind.discard if is_active else self._behind.add)(map_id)
            self._metrics.maps_behind.set(len(self._behind))
        if changed:
            _log.info("serving", map_id=map_id, version=version, is_active=is_active)

    def _forget(self, map_id: str) -> None:
        """A map that has nothing active any more."""
        with self._lock:
            self._serving.pop(map_id, None)
            self._behind.discard(map_id)
            self._tried.discard(map_id)
            self._metrics.maps_behind.set(len(self._behind))

    def _load(self, map_id: str, version: str) -> ServedVersion:
        key = (map_id, version)
        with self._lock:
            if key in self._loaded:
                self._loaded.move_to_end(key)
                return self._loaded[key]
            load_lock = self._load_locks.setdefault(key, threading.Lock())
        with load_lock:  # whoever else wants it waits for this load instead of doing it again
            with self._lock:
                if key in self._loaded:
                    return self._loaded[key]
                refusal = self._refused.get(key)
            if refusal is not None and time.monotonic() < refusal.until:
                raise refusal.error
            served = self._fetch_and_load(map_id, version)
            with self._lock:
                self._refused.pop(key, None)
                self._loaded[key] = served
                gone = self._make_room()
        for old in gone:
            self._remove_files(old)
        return served

    def _fetch_and_load(self, map_id: str, version: str) -> ServedVersion:
        start = time.perf_counter()
        try:
            manifest = self._catalog.manifest(map_id, version)
            directory = self._catalog.fetch_version(map_id, version, self._directory)
            localizer = self._load_files(directory)
        except VersionError as error:
            with self._lock:
                self._refused[(map_id, version)] = _Refusal(error, time.monotonic() + REFUSED_FOR_S)
            self._metrics.version_loads.labels(error.code).inc()
            _log.error("version refused", map_id=map_id, version=version, code=error.code, error=str(error))
            raise
        except NotFound:  # a version that somebody made up leaves no trace
            with self._lock:
                self._load_locks.pop((map_id, version), None)
            raise
        seconds = time.perf_counter() - start
        self._metrics.version_loads.labels("ok").inc()
        self._metrics.load_seconds.observe(seconds)
        _log.info("version loaded", map_id=map_id, version=version, seconds=round(seconds, 3))
        return ServedVersion(map_id, version, localizer, directory, manifest.total_bytes)

    def _make_room(self) -> list[ServedVersion]:
        """Puts out the least recently used until the limits hold; the newest always stays."""
        gone = []
        while len(self._loaded) > 1 and (
            len(self._loaded) > self._max_versions or self._bytes() > self._max_bytes
        ):
            gone.append(self._loaded.popitem(last=False)[1])
            self._metrics.version_evictions.inc()
        self._metrics.versions_loaded.set(len(self._loaded))
        self._metrics.version_bytes.set(self._bytes())
        return gone

    def _bytes(self) -> int:
        return sum(served.file_bytes for served in self._loaded.values())

    def _remove_files(self, old: ServedVersion) -> None:
        """Off the disk too, or every version ever served stays there. Queries that it began keep their
        mapped files. A file store's own files are not in the cache directory, and stay."""
        _log.info("version put out", map_id=old.map_id, version=old.version)
        if old.directory.parent != self._directory:
            return
        with self._lock:
            load_lock = self._load_locks.setdefault((old.map_id, old.version), threading.Lock())
        if not load_lock.acquire(blocking=False):  # somebody is loading it again
            return
        try:
            with self._lock:
                if any(served.directory == old.directory for served in self._loaded.values()):
                    return
            with suppress(OSError):
                shutil.rmtree(old.directory)
        finally:
            load_lock.release()
