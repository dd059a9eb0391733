"""Which version of each map answers: loaded on demand, swapped when another is activated, never a bad one.

Where replicas share the maps (``holding``) those that this one holds are loaded ahead, and put out last."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_state import MapState
from firstfix.errors import FirstfixError, NotFound, StoreError, VersionError

from ..query_workers.base import QueryWorkers
from ..query_workers.query import ServedVersion
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import in_this_context
from .catalog_watch import CatalogWatch
from .eviction_order import Key
from .leases import Leases, together
from .loaded_versions import Lease, ResidentVersions
from .placement import Holding
from .prefetch import LoadAhead, Round
from .served_maps import ServedMaps
from .version_loader import VersionLoader

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
        workers: QueryWorkers,
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
        self.served = ServedMaps(metrics)
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
        self._waiting: dict[tuple[str, str | None], list[Future[Lease]]] = {}
        self._threads = ThreadPoolExecutor(LOADERS, thread_name_prefix="map-loader")
        self.polled = False

    @property
    def held_loaded(self) -> int:
        """Maps held here whose serving version is in memory."""
        return self._resident.kept

    def is_offered(self, map_id: str) -> bool:
        """Whether callers who choose should ask here: every map that is served; where replicas share them
        one that is held, by its first holder always, by others while it is in memory."""
        if self.holding is None or map_id in self._pinned or map_id not in self.served:
            return map_id in self.served
        if self.holding.is_first(map_id):
            return True
        return map_id in self.holding and self._is_loaded(map_id)

    def lease(self, map_ids: Sequence[str], version: str | None = None) -> Future[Leases]:
        """The versions to answer a query from, of one map or several: the named one, else the active ones.
        Done at once where they are in memory; else a load goes on elsewhere, one however many ask.

        Args:
            map_ids, version: well-formed (``firstfix.ids``).

        The future raises:
            NotFound: no such map or version.
            VersionError: it cannot be served, nor can one that was active before.
            StoreError: the store failed.
        """
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
        known = set(self.served.ids)
        names, listed = self._watch.look()
        states = self._states(names)
        seen = {map_id for map_id, state in states.items() if state.published}
        gone = states.keys() - seen
        if listed is not None:
            gone |= known - listed
        for map_id in gone:
            self._forget(map_id)
        self.served.add(seen)
        if self.holding is not None:
            self.holding.know(seen)
        self._see_to({map_id: states[map_id] for map_id in seen & self._pinned})
        self._see_to({map_id: states[map_id] for map_id in seen - self._pinned})
        missing = [] if self.polled else sorted(self._pinned - self.served.versions.keys())
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
        self.served.touch(moved.changed)
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
        lease = self._resident.lease((map_id, version or self.served.version(map_id) or ""))
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
                is_due = self._is_due(map_id, states[map_id], this)
                this.decided(map_id)
                if is_due:
                    self._follow(map_id, states[map_id]).close()
            except FirstfixError as error:
                _log.warning("cannot serve", map_id=map_id, code=error.code, error=str(error))
                return not isinstance(error, NotFound | StoreError)
            finally:
                self.served.touch([map_id])
            return True

        self._ahead.see_to(states, see_to, superseded)

    def _load_held(self, superseded: Callable[[], bool] = lambda: False) -> None:
        waiting = self._ahead.held_and_not_settled()
        self._see_to({map_id: self._catalog.known_state(map_id) for map_id in waiting}, superseded)

    def _is_due(self, map_id: str, state: MapState, this: Round) -> bool:
        """Whether a map has to be seen to: it answers and another version is active now, or it was never
        asked for and there is room. One that was put out comes back with its next query."""
        if self._is_loaded(map_id):
            return self.served.is_behind(map_id) or state.active != self.served.version(map_id)
        if map_id in self._pinned:
            return True
        if state.active is None:
            return True  # there is nothing to serve yet, or any more
        return not self._ahead.is_settled(map_id) and this.has_room(map_id, state.active)

    def _serve(self, map_id: str, version: str, *, is_active: bool) -> None:
        if self.holding is not None:
            self.holding.know([map_id])
        before = self.served.serve(map_id, version, is_active=is_active)
        if before != version:
            self._resident.succeed((map_id, version), None if before is None else (map_id, before))
            _log.info("serving", map_id=map_id, version=version, is_active=is_active)

    def _forget(self, map_id: str) -> None:
        """A map that has nothing active any more."""
        self.served.forget(map_id)
        self._ahead.begin_again([map_id])
        if self.holding is not None:
            self.holding.forget(map_id)

    def _is_loaded(self, map_id: str) -> bool:
        """Whether the version that answers is in memory."""
        version = self.served.version(map_id)
        return version is not None and (map_id, version) in self._resident

    def _stays(self, candidate: Key, coming: Key) -> bool:
        """What serves is not put out for its own map's next version, nor where it is pinned."""
        map_id, version = candidate
        serves = self.served.version(map_id) == version
        return serves and (map_id in self._pinned or map_id == coming[0])

    def _left(self, key: Key) -> None:
        self.served.touch([key[0]])

    def _keeps(self, key: Key) -> bool:
        """What serves of a map that is held here is put out last."""
        map_id, version = key
        return self.holding is not None and map_id in self.holding and self.served.version(map_id) == version
