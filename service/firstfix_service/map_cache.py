"""Which version of each map answers: loaded on demand, swapped when another is activated, never a bad one."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import structlog

from firstfix.catalog import Catalog
from firstfix.errors import FirstfixError, NotFound, VersionError
from firstfix.ids import check_map_id, check_version
from firstfix.map_log import MapState

from .catalog_watch import CatalogWatch
from .metrics import Metrics
from .query import ServedVersion
from .request_scope import in_this_context
from .resident import Key, Lease, ResidentVersions
from .version_loader import VersionLoader
from .workers import Workers

_log = structlog.get_logger(__name__)
LOADERS = 8  # versions fetched and loaded at the same time: one slow one does not hold up the others
READERS = 16  # map logs read at the same time when the service starts


class Leases:
    """The versions that one query needs."""

    def __init__(self, leases: Sequence[Lease]) -> None:
        self._leases = leases
        self.served = tuple(lease.served for lease in leases)

    def close(self) -> None:
        for lease in self._leases:
            lease.close()


class MapCache:
    """Thread-safe.

    Args:
        pinned: maps whose serving version is loaded at the start and never put out.
    """

    def __init__(
        self,
        catalog: Catalog,
        directory: Path,
        workers: Workers,
        metrics: Metrics,
        *,
        max_versions: int,
        max_bytes: int,
        max_disk_bytes: int,
        pinned: Iterable[str] = (),
        poll_interval_s: float = 2.0,
        sweep_interval_s: float = 60.0,
    ) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._pinned = frozenset(pinned)
        self._resident = ResidentVersions(
            workers, metrics, max_versions=max_versions, max_bytes=max_bytes, stays=self._stays
        )
        self._loader = VersionLoader(
            catalog, self._resident, metrics, directory, max_disk_bytes=max_disk_bytes
        )
        self._watch = CatalogWatch(catalog, interval_s=poll_interval_s, sweep_s=sweep_interval_s)
        self._lock = threading.Lock()
        self._serving: dict[str, str] = {}  # map id -> version that answers when none is named
        self._behind: set[str] = set()  # maps whose active version was refused
        self._tried: set[str] = set()  # maps that the poll has loaded ahead of their first query, or not
        self._published: set[str] = set()  # maps with a version
        self._waiting: dict[tuple[str, str | None], list[Future[Lease]]] = {}
        self._threads = ThreadPoolExecutor(LOADERS, thread_name_prefix="map-loader")
        self.polled = False

    @property
    def map_ids(self) -> list[str]:
        """Maps with a version, as of the last poll or a query since, in order."""
        with self._lock:
            return sorted(self._published)

    @property
    def serving(self) -> dict[str, str]:
        """Map id to the version that answers when none is named, of maps asked for or loaded so far."""
        with self._lock:
            return dict(self._serving)

    def lease(self, map_ids: Sequence[str], version: str | None = None) -> Future[Leases]:
        """The versions to answer a query from, of one map or several: the named one, else the active ones.
        Done at once where they are in memory; else a load goes on elsewhere, one however many ask.

        Raises:
            InvalidOption: an id or version that is none.

        The future raises:
            NotFound: no such map or version.
            VersionError: it cannot be served, nor can one that was active before.
            StoreError: the store failed.
        """
        for map_id in map_ids:
            check_map_id(map_id)
        if version is not None:
            check_version(version)
        if len(map_ids) == 1:
            return _together([self._lease(map_ids[0], version)])
        self._resident.begin_hurry()
        gathered = _together([self._lease(map_id, version) for map_id in map_ids])
        gathered.add_done_callback(lambda _: self._resident.end_hurry())
        return gathered

    def refresh(self, map_id: str) -> ServedVersion:
        """Reads the map's log and serves what it says: the active version, or when that one is refused the
        one that was active before, as a replica that never stopped would.

        Raises:
            as the future of ``lease``.
        """
        lease = self._follow(map_id, self._catalog.state(map_id))
        lease.close()
        return lease.served

    def poll(self) -> None:
        """Looks for maps and activations that are new. What cannot be read stays as it is."""
        if not self.polled:
            self._watch.start_again()
        with self._lock:
            known = set(self._published)
        names, listed = self._watch.look()
        states = self._states(names)
        seen = {map_id for map_id, state in states.items() if state.published}
        gone = states.keys() - seen
        if listed is not None:
            gone |= known - listed
        for map_id in gone:
            self._forget(map_id)
        with self._lock:
            self._published |= seen
        for map_id in sorted(seen, key=lambda name: (name not in self._pinned, name)):
            try:
                if self._is_due(map_id, states[map_id]):
                    self._follow(map_id, states[map_id]).close()
            except FirstfixError as error:
                _log.warning("cannot serve", map_id=map_id, code=error.code, error=str(error))
        with self._lock:
            missing = [] if self.polled else sorted(self._pinned - self._serving.keys())
        for map_id in missing:
            _log.warning("a pinned map is not served", map_id=map_id)
        self.polled = True

    def close(self) -> None:
        """Ends the loads that have begun; others are not begun."""
        self._threads.shutdown(cancel_futures=True)
        self._resident.close()

    def _lease(self, map_id: str, version: str | None) -> Future[Lease]:
        future: Future[Lease] = Future()
        with self._lock:
            key = (map_id, version or self._serving.get(map_id, ""))
        lease = self._resident.lease(key)
        self._metrics.cache_lookups.labels("miss" if lease is None else "hit").inc()
        if lease is not None:
            future.set_result(lease)
            return future
        wanted = (map_id, version)
        with self._lock:
            waiting = self._waiting.setdefault(wanted, [])
            waiting.append(future)
            if len(waiting) == 1:
                self._threads.submit(in_this_context(self._load_for), wanted)
        return future

    def _load_for(self, wanted: tuple[str, str | None]) -> None:
        map_id, version = wanted
        try:
            if version is not None:
                lease = self._loader.load(map_id, version)
            else:
                lease = self._follow(map_id, self._catalog.state(map_id))
        except BaseException as error:
            with self._lock:
                futures = self._waiting.pop(wanted)
            for future in futures:
                future.set_exception(error)
            return
        with self._lock:
            futures = self._waiting.pop(wanted)
        for future in futures:
            future.set_result(lease.again())
        lease.close()

    def _follow(self, map_id: str, state: MapState) -> Lease:
        if not state.activated:
            self._forget(map_id)
            what = f"map {map_id} has no active version" if state.published else f"no map {map_id}"
            raise NotFound(what)
        first_error: VersionError | None = None
        for version in state.activated:
            try:
                lease = self._loader.load(map_id, version)
            except VersionError as error:
                first_error = first_error or error
                continue
            self._serve(map_id, version, is_active=version == state.active)
            return lease
        assert first_error is not None
        raise first_error

    def _states(self, map_ids: Sequence[str]) -> dict[str, MapState]:
        """
        Raises:
            StoreError: of the first look, which must see all; later a map that cannot be read has to wait.
        """
        if self.polled and len(map_ids) < READERS:
            return {map_id: state for map_id in map_ids if (state := self._state(map_id)) is not None}
        with ThreadPoolExecutor(READERS, thread_name_prefix="map-reader") as threads:
            states = threads.map(self._state, map_ids)
            return {name: state for name, state in zip(map_ids, states, strict=True) if state is not None}

    def _state(self, map_id: str) -> MapState | None:
        try:
            return self._catalog.state(map_id)
        except FirstfixError as error:
            if not self.polled:
                raise
            _log.warning("cannot read a map's log", map_id=map_id, code=error.code, error=str(error))
            return None

    def _is_due(self, map_id: str, state: MapState) -> bool:
        """Whether the poll has to see to a map: it answers and another version is active now, or it was
        never asked for and there is room. One that was put out comes back with its next query."""
        with self._lock:
            serving = self._serving.get(map_id)
            behind = map_id in self._behind
            tried = map_id in self._tried
            self._tried.add(map_id)
        if serving is not None and (map_id, serving) in self._resident:
            return behind or state.active != serving
        return map_id in self._pinned or (not tried and self._resident.has_room)

    def _serve(self, map_id: str, version: str, *, is_active: bool) -> None:
        with self._lock:
            changed = self._serving.get(map_id) != version
            self._serving[map_id] = version
            self._published.add(map_id)
            (self._behind.discard if is_active else self._behind.add)(map_id)
            self._metrics.maps_behind.set(len(self._behind))
        if changed:
            self._resident.trim((map_id, version))
            _log.info("serving", map_id=map_id, version=version, is_active=is_active)

    def _forget(self, map_id: str) -> None:
        """A map that has nothing active any more."""
        with self._lock:
            self._published.discard(map_id)
            self._serving.pop(map_id, None)
            self._behind.discard(map_id)
            self._tried.discard(map_id)
            self._metrics.maps_behind.set(len(self._behind))

    def _stays(self, candidate: Key, coming: Key) -> bool:
        """What serves is not put out for its own map's next version, nor where it is pinned."""
        map_id, version = candidate
        serves = self._serving.get(map_id) == version
        return serves and (map_id in self._pinned or map_id == coming[0])


def _together(futures: Sequence[Future[Lease]]) -> Future[Leases]:
    """All of them, or the first error when all have ended."""
    gathered: Future[Leases] = Future()
    left = len(futures)
    lock = threading.Lock()

    def ended(_: Future[Lease]) -> None:
        nonlocal left
        with lock:
            left -= 1
            if left:
                return
        errors = [error for future in futures if (error := future.exception()) is not None]
        if not errors:
            gathered.set_result(Leases([future.result() for future in futures]))
            return
        for future in futures:
            if future.exception() is None:
                future.result().close()
        gathered.set_exception(errors[0])

    for future in futures:
        future.add_done_callback(ended)
    return gathered
