"""The maps that this process serves: versions are loaded on demand and follow the active version of each map.

A version that cannot be served is refused, and the version that was active before it answers. Where replicas
share the maps (``Placement``), the maps that this replica holds are prefetched and evicted last.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_state import MapState
from firstfix.errors import FirstfixError, NotFound, StoreError, VersionError

from ..query_workers.base import QueryWorkers
from ..query_workers.query import ServedVersion
from ..telemetry.metrics import Metrics
from .catalog_watch import SWEEP_INTERVAL_S, CatalogWatch, read_states
from .loaded_versions import Lease, LoadedVersions
from .placement import Placement
from .prefetch import Prefetcher, PrefetchRound
from .served_maps import ServedMaps
from .version_files import Key
from .version_loader import SharedLoads, VersionLoader
from .warm_up import warm_up

_log = structlog.get_logger(__name__)
# A process has at most 65,530 mappings (vm.max_map_count), and a version takes 12. The bytes end before.
MAX_VERSIONS = 2000
MAX_WARM_UPS = 8  # in one poll: at the start thousands of maps may be loaded, and the first ones set up most
_NAMED_ENTRIES = 10  # damaged ones of a log, in a message


def _never() -> bool:
    return False


def _of_damage(state: MapState) -> str:
    """The damaged entries of a map's log as the end of a message; empty without any."""
    if not state.doubtful:
        return ""
    numbers = ", ".join(map(str, state.doubtful[-_NAMED_ENTRIES:]))
    return f": in its log these entries are damaged or missing: {numbers} (`firstfix maps verify --repair`)"


def _why_not_served(map_id: str, state: MapState) -> str:
    """The reason why a map has no active version. A robot may have had answers in one that was taken back."""
    if state.published:
        return f"map {map_id} has no active version"
    if not state.exists:
        return f"no map {map_id}"
    return f"map {map_id} has no version any more: its last one was taken out of service"


class MapCache:
    """The versions that answer queries. Thread-safe.

    Args:
        pinned: maps whose serving version is loaded at the start and never evicted.
        placement: the maps to prefetch; None: any map, while there is room.
        on_read: called with the active versions of the maps that a poll has read; None: there is none.
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
        placement: Placement | None = None,
        poll_interval_s: float = 2.0,
        sweep_interval_s: float = SWEEP_INTERVAL_S,
        on_read: Callable[[Mapping[str, str | None]], None] = lambda active: None,
    ) -> None:
        self._catalog = catalog
        self._on_read = on_read
        self._workers = workers
        self._metrics = metrics
        self._pinned = frozenset(pinned)
        self.placement = placement
        self._loaded = LoadedVersions(
            workers,
            metrics,
            max_versions=max_versions,
            max_bytes=max_bytes,
            must_stay=self._must_stay,
            is_protected=self._is_held_and_serving,
            on_evict=lambda key: self.served.touch([key[0]]),
        )
        self._prefetcher = Prefetcher(catalog, self._loaded, placement)
        self._loader = VersionLoader(catalog, self._loaded, metrics, directory, max_disk_bytes=max_disk_bytes)
        self._loads = SharedLoads(self._load)
        self.served = ServedMaps(self._loaded, self._loads.request, metrics)
        self._watch = CatalogWatch(catalog, interval_s=poll_interval_s, sweep_s=sweep_interval_s)
        self.polled = False

    @property
    def held_loaded(self) -> int:
        """Number of held maps whose serving version is in memory."""
        return self._loaded.protected

    def is_offered(self, map_id: str) -> bool:
        """Whether clients that choose a replica should choose this one for the map.

        Without a placement a replica offers every map that it serves. With one, the first holder of a map
        offers it always, and the other holders offer it while it is in memory.
        """
        if self.placement is None or map_id in self._pinned or map_id not in self.served:
            return map_id in self.served
        if self.placement.is_first_holder(map_id):
            return True
        return map_id in self.placement and self._is_loaded(map_id)

    def check_files(self, versions: Iterable[ServedVersion]) -> None:
        """Read the files of versions again, on which a query failed. Blocks.

        Raises:
            CorruptVersion: a file is damaged. The map's next query gets another version, or the reason.
        """
        for served in versions:
            self._loader.check_files(served)

    def refresh(self, map_id: str) -> ServedVersion:
        """Read the map's log and serve its active version, or the one before if that is refused.

        It is warmed up before: until then the version before it answers.

        Raises:
            NotFound, VersionError, StoreError: as the future of ``ServedMaps.lease``.
        """
        lease = self._follow(map_id, self._catalog.state(map_id), warms_up=True)
        lease.close()
        return lease.served

    def poll(self) -> None:
        """Look for new maps and activations. Maps whose logs cannot be read stay as they are.

        Raises:
            StoreError: the store failed. At the first poll, also if one map's log cannot be read.
        """
        if not self.polled:
            self._watch.reset()
        known = set(self.served.ids)
        names, listed = self._watch.poll()
        states = read_states(self._catalog, names, strict=not self.polled)
        seen = {map_id for map_id, state in states.items() if state.active is not None}
        gone = states.keys() - seen
        if listed is not None:
            gone |= known - listed
        for map_id in gone:
            left = states.get(map_id)
            if left is not None and left.published and (map_id in known or not self.polled):
                _log.warning(f"a map has no active version{_of_damage(left)}", map_id=map_id)
            self._forget(map_id)
        self.served.add(seen)
        self._on_read({**dict.fromkeys(gone), **{map_id: states[map_id].active for map_id in seen}})
        if self.placement is not None:
            self.placement.add_maps(seen)
        self._follow_and_prefetch({map_id: states[map_id] for map_id in seen & self._pinned})
        self._follow_and_prefetch({map_id: states[map_id] for map_id in seen - self._pinned})
        missing = [] if self.polled else sorted(self._pinned - self.served.versions.keys())
        for map_id in missing:
            _log.warning("a pinned map is not served", map_id=map_id)
        if not self.polled:
            self.polled = True
            if self.placement is not None:  # the replicas may have changed during the poll
                self._prefetch_held()

    def set_replicas(
        self,
        replicas: Iterable[str],
        on_offer_changed: Callable[[], None] = lambda: None,
        is_superseded: Callable[[], bool] = _never,
    ) -> None:
        """Place the maps on these replicas. Blocks while it loads the maps that came to this replica.

        Args:
            on_offer_changed: called when ``is_offered`` has changed: at first, and when all is loaded.
            is_superseded: whether the replicas have changed again: then no more maps are loaded.
        """
        assert self.placement is not None
        change = self.placement.set_replicas(replicas)
        self.served.touch(change.changed)
        self._prefetcher.unsettle(change.gained)
        self._loaded.reclassify()
        if self.polled:  # otherwise the first poll does it
            on_offer_changed()
            self._prefetch_held(is_superseded)
            on_offer_changed()

    def stop_prefetch(self) -> None:
        """Begin no more loads that no query asked for."""
        self._prefetcher.stop()

    def close(self) -> None:
        """Wait for the loads that have begun; the others are cancelled."""
        self.stop_prefetch()
        self._loads.close()
        self._loaded.close()

    def _load(self, map_id: str, version: str | None) -> Lease:
        if version is not None:
            return self._loader.load(map_id, self._catalog.full_version(map_id, version))
        return self._follow(map_id, self._catalog.state(map_id), warms_up=False)  # a query waits for it

    def _follow(self, map_id: str, state: MapState, *, warms_up: bool) -> Lease:
        """Load and serve the active version, or the last one before it that is not refused."""
        if not state.activated:
            self._forget(map_id)
            if not state.exists and not state.doubtful:
                raise NotFound.of_map(map_id)
            raise NotFound(f"{_why_not_served(map_id, state)}{_of_damage(state)}")
        first_error: VersionError | None = None
        for version in state.activated:
            try:
                lease = self._loader.load(map_id, version)
            except VersionError as error:
                first_error = first_error or error
                continue
            if warms_up:
                warm_up(self._workers, lease.served, self._metrics)
            self._serve(map_id, version, is_active=version == state.active)
            if state.doubtful:
                _log.warning(
                    "entries of the map's log are damaged or missing: another version may be the active one",
                    map_id=map_id,
                    version=version,
                    entries=state.doubtful[-_NAMED_ENTRIES:],
                )
            return lease
        assert first_error is not None
        raise first_error

    def _follow_and_prefetch(
        self, states: Mapping[str, MapState], is_superseded: Callable[[], bool] = _never
    ) -> None:
        """Follow the maps whose active version has changed, and prefetches maps while there is room."""
        warm_ups = threading.Semaphore(MAX_WARM_UPS)

        def follow(map_id: str, this_round: PrefetchRound) -> bool:
            try:
                is_due = self._is_due(map_id, states[map_id], this_round)
                this_round.decided(map_id)
                if is_due:
                    warms_up = warm_ups.acquire(blocking=False)
                    self._follow(map_id, states[map_id], warms_up=warms_up).close()
            except FirstfixError as error:
                _log.warning("cannot serve a map", map_id=map_id, code=error.code, error=str(error))
                return not isinstance(error, NotFound | StoreError)
            finally:
                self.served.touch([map_id])
            return True

        self._prefetcher.run_round(states, follow, is_superseded)

    def _prefetch_held(self, is_superseded: Callable[[], bool] = _never) -> None:
        map_ids = self._prefetcher.unsettled_held_maps()
        states = {map_id: self._catalog.known_state(map_id) for map_id in map_ids}
        self._follow_and_prefetch(states, is_superseded)

    def _is_due(self, map_id: str, state: MapState, this_round: PrefetchRound) -> bool:
        """Decide whether to load a map: its active version has changed, or there is room to prefetch it.

        A map that was evicted comes back with its next query.
        """
        if self._is_loaded(map_id):
            return self.served.is_behind(map_id) or state.active != self.served.version(map_id)
        if map_id in self._pinned:
            return True
        if state.active is None:
            return True  # ``_follow`` then takes it out
        return not self._prefetcher.is_settled(map_id) and this_round.take_room(map_id, state.active)

    def _serve(self, map_id: str, version: str, *, is_active: bool) -> None:
        if self.placement is not None:
            self.placement.add_maps([map_id])
        before = self.served.serve(map_id, version, is_active=is_active)
        if before != version:
            self._loaded.serving_changed((map_id, version), None if before is None else (map_id, before))
            _log.info("serving", map_id=map_id, version=version, is_active=is_active)

    def _forget(self, map_id: str) -> None:
        """Remove a map that has no active version any more."""
        self.served.forget(map_id)
        self._prefetcher.unsettle([map_id])
        if self.placement is not None:
            self.placement.remove_map(map_id)

    def _is_loaded(self, map_id: str) -> bool:
        """Whether the serving version is in memory."""
        version = self.served.version(map_id)
        return version is not None and (map_id, version) in self._loaded

    def _must_stay(self, candidate: Key, coming: Key) -> bool:
        """Whether a version serves a pinned map, or the map whose next version is coming."""
        map_id, version = candidate
        serves = self.served.version(map_id) == version
        return serves and (map_id in self._pinned or map_id == coming[0])

    def _is_held_and_serving(self, key: Key) -> bool:
        map_id, version = key
        if self.placement is None or map_id not in self.placement:
            return False
        return self.served.version(map_id) == version
