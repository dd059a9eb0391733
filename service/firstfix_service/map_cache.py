"""Which version of each map answers: loaded on demand, swapped when another is activated, never a bad one.

Where replicas share the maps (``holding``) those that this one holds are loaded ahead, and put out last."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import structlog

from firstfix.catalog import Catalog
from firstfix.errors import FirstfixError, NotFound, StoreError, VersionError
from firstfix.ids import check_map_id, check_version
from firstfix.map_log import MapState

from .catalog_watch import CatalogWatch
from .holding import Holding
from .leases import Leases, together
from .leaving_order import Key
from .load_ahead import LoadAhead, Round
from .metrics import Metrics
from .query import ServedVersion
from .request_scope import in_this_context
from .resident import Lease, ResidentVersions
from .version_loader import VersionLoader
from .workers import Workers

_log = structlog.get_logger(__name__)
LOADERS = 8  # versions fetched and loaded for queries at the same time: a slow one does not hold up others
READERS = 16  # map logs read at the same time when the service starts


class MapCache:
    """Thread-safe.

    Args:
        pinned: maps whose serving version is loaded at the start and never put out.
        holding: which maps are loaded ahead; None: any, while there is room.
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
        holding: Holding | None = None,
        poll_interval_s: float = 2.0,
        sweep_interval_s: float = 60.0,
    ) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._pinned = frozenset(pinned)
        self.holding = holding
        self._resident = ResidentVersions(
            workers,
            metrics,
            max_versions=max_versions,
            max_bytes=max_bytes,
            stays=self._stays,
            keeps=self._keeps,
            left=self._left,
        )
        self._ahead = LoadAhead(catalog, self._resident, holding)
        self._loader = VersionLoader(
            catalog, self._resident, metrics, directory, max_disk_bytes=max_disk_bytes
        )
        self._watch = CatalogWatch(catalog, interval_s=poll_interval_s, sweep_s=sweep_interval_s)
        self._lock = threading.Lock()
        self._serving: dict[str, str] = {}  # map id -> version that answers when none is named
        self._behind: set[str] = set()  # maps whose active version was refused
        self._touched: set[str] = set()  # maps of which something may have changed, for ``take_touched``
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

    @property
    def maps_served(self) -> int:
        with self._lock:
            return len(self._published)

    @property
    def held_loaded(self) -> int:
        """Maps held here whose serving version is in memory."""
        return self._resident.kept

    def serving_version(self, map_id: str) -> str | None:
        with self._lock:
            return self._serving.get(map_id)

    def is_served(self, map_id: str) -> bool:
        """Whether it has a version, as of the last poll or a query since."""
        with self._lock:
            return map_id in self._published

    def is_offered(self, map_id: str) -> bool:
        """Whether callers who choose should ask here: every map that is served; where replicas share them
        one that is held, by its first holder always, by others while it is in memory."""
        with self._lock:
            serving = self._serving.get(map_id)
            if self.holding is None or map_id in self._pinned or map_id not in self._published:
                return map_id in self._published
        if self.holding.is_first(map_id):
            return True
        return map_id in self.holding and serving is not None and (map_id, serving) in self._resident

    def take_touched(self) -> set[str]:
        """Maps of which what the methods above say, or their logs, may have changed since the last call."""
        with self._lock:
            touched, self._touched = self._touched, set()
            return touched

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
            return together([self._lease(map_ids[0], version)])
        self._resident.begin_hurry()
        gathered = together([self._lease(map_id, version) for map_id in map_ids])
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
            self._touched |= seen
        if self.holding is not None:
            self.holding.know(seen)
        self._see_to({map_id: states[map_id] for map_id in seen & self._pinned})
        self._see_to({map_id: states[map_id] for map_id in seen - self._pinned})
        with self._lock:
            missing = [] if self.polled else sorted(self._pinned - self._serving.keys())
        for map_id in missing:
            _log.warning("a pinned map is not served", map_id=map_id)
        if not self.polled:
            self.polled = True
            if self.holding is not None:  # the replicas may have changed meanwhile
                self._load_held()

    def share(
        self,
        replicas: Iterable[str],
        shown: Callable[[], None] = lambda: None,
        superseded: Callable[[], bool] = lambda: False,
    ) -> None:
        """These replicas share the maps from now on. Blocks while it loads what has come to this one.

        Args:
            shown: called when ``is_offered`` has changed: at first, and when all is loaded.
            superseded: whether other replicas share them by now: then it loads no more.
        """
        assert self.holding is not None
        moved = self.holding.see(replicas)
        with self._lock:
            self._touched |= moved.changed
        self._ahead.begin_again(moved.come)
        self._resident.sort_again()
        if self.polled:  # else the first poll sees to it
            shown()
            self._load_held(superseded)
            shown()

    def load_no_more(self) -> None:
        """What is loaded ahead ends with what has begun."""
        self._ahead.stop()

    def close(self) -> None:
        """Ends the loads that have begun; others are not begun."""
        self.load_no_more()
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

    def _see_to(self, states: Mapping[str, MapState], superseded: Callable[[], bool] = lambda: False) -> None:
        """Follows the maps that another version is active of, and loads maps ahead while there is room."""

        def see_to(map_id: str, this: Round) -> bool:
            try:
                if self._is_due(map_id, states[map_id], this):
                    self._follow(map_id, states[map_id]).close()
            except FirstfixError as error:
                _log.warning("cannot serve", map_id=map_id, code=error.code, error=str(error))
                return not isinstance(error, NotFound | StoreError)
            finally:
                with self._lock:
                    self._touched.add(map_id)
            return True

        self._ahead.see_to(states, see_to, superseded)

    def _load_held(self, superseded: Callable[[], bool] = lambda: False) -> None:
        waiting = self._ahead.held_and_not_settled()
        self._see_to({map_id: self._catalog.known_state(map_id) for map_id in waiting}, superseded)

    def _is_due(self, map_id: str, state: MapState, this: Round) -> bool:
        """Whether a map has to be seen to: it answers and another version is active now, or it was never
        asked for and there is room. One that was put out comes back with its next query."""
        with self._lock:
            serving = self._serving.get(map_id)
            behind = map_id in self._behind
        if serving is not None and (map_id, serving) in self._resident:
            return behind or state.active != serving
        if map_id in self._pinned:
            return True
        if state.active is None:
            return True  # there is nothing to serve yet, or any more
        return not self._ahead.is_settled(map_id) and this.has_room(map_id, state.active)

    def _serve(self, map_id: str, version: str, *, is_active: bool) -> None:
        if self.holding is not None:
            self.holding.know([map_id])
        with self._lock:
            before = self._serving.get(map_id)
            self._serving[map_id] = version
            self._published.add(map_id)
            self._touched.add(map_id)
            (self._behind.discard if is_active else self._behind.add)(map_id)
            self._metrics.maps_behind.set(len(self._behind))
        if before != version:
            self._resident.succeed((map_id, version), None if before is None else (map_id, before))
            _log.info("serving", map_id=map_id, version=version, is_active=is_active)

    def _forget(self, map_id: str) -> None:
        """A map that has nothing active any more."""
        with self._lock:
            self._published.discard(map_id)
            self._serving.pop(map_id, None)
            self._behind.discard(map_id)
            self._touched.add(map_id)
            self._metrics.maps_behind.set(len(self._behind))
        self._ahead.begin_again([map_id])
        if self.holding is not None:
            self.holding.forget(map_id)

    def _stays(self, candidate: Key, coming: Key) -> bool:
        """What serves is not put out for its own map's next version, nor where it is pinned."""
        map_id, version = candidate
        serves = self._serving.get(map_id) == version
        return serves and (map_id in self._pinned or map_id == coming[0])

    def _left(self, key: Key) -> None:
        with self._lock:
            self._touched.add(key[0])

    def _keeps(self, key: Key) -> bool:
        """What serves of a map that is held here is put out last."""
        map_id, version = key
        return self.holding is not None and map_id in self.holding and self._serving.get(map_id) == version
