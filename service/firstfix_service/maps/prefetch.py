"""Prefetch: maps are loaded before they are queried, each once, while there is room.

Where replicas share the maps, a replica prefetches the maps that it holds.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

from firstfix.catalog.catalog import Catalog

from .loaded_versions import LoadedVersions
from .placement import Placement

THREADS = 8
FEW = 16  # so few maps are loaded without threads


class Prefetcher:
    """Runs rounds of prefetch and remembers which maps are settled. Thread-safe.

    A map is settled when it was loaded, or there was no room for it, or it cannot be loaded.
    """

    def __init__(self, catalog: Catalog, loaded: LoadedVersions, placement: Placement | None) -> None:
        self._catalog = catalog
        self._loaded = loaded
        self._placement = placement
        self._lock = threading.Lock()
        self._settled: set[str] = set()
        self._stop = threading.Event()

    def is_settled(self, map_id: str) -> bool:
        """Whether the map needs no prefetch any more."""
        return map_id in self._settled

    def unsettle(self, map_ids: Iterable[str]) -> None:
        """Make these maps candidates for prefetch again."""
        with self._lock:
            self._settled.difference_update(map_ids)

    def unsettled_held_maps(self) -> list[str]:
        """The held maps that are not settled; none if replicas share nothing."""
        held = () if self._placement is None else self._placement.maps
        return [map_id for map_id in held if map_id not in self._settled]

    def stop(self) -> None:
        """End the rounds: loads that have begun go on, no other load begins."""
        self._stop.set()

    def run_round(
        self,
        map_ids: Iterable[str],
        follow: Callable[[str, PrefetchRound], bool],
        is_superseded: Callable[[], bool],
    ) -> None:
        """Run one round; many maps are loaded by several threads, the maps with the best rank first.

        Args:
            follow: loads a map if it is due. Returns False if the map should be tried again in another round.
            is_superseded: whether the round should end.
        """
        names = sorted(map_ids) if self._placement is None else self._placement.sorted_by_rank(map_ids)
        this_round = PrefetchRound(self._catalog, self._loaded, self._placement, names)

        def one(map_id: str) -> None:
            try:
                if is_superseded() or self._stop.is_set():
                    return
                is_settled = follow(map_id, this_round)
            finally:
                this_round.load_ended(map_id)
            if is_settled and (self._placement is None or map_id in self._placement):
                with self._lock:
                    self._settled.add(map_id)

        if len(names) <= FEW:
            for name in names:
                one(name)
            return
        with ThreadPoolExecutor(THREADS, thread_name_prefix="map-prefetch") as threads:
            list(threads.map(one, names))


class PrefetchRound:
    """Shares out the free room among the maps of one round, in a fixed order. Thread-safe.

    Each map gets room after the maps before it in the order, whichever thread is faster. When there is no
    room for one of them, the maps after it get none.

    Args:
        order: the maps, the most important first. Their threads begin in this order.
    """

    def __init__(
        self, catalog: Catalog, loaded: LoadedVersions, placement: Placement | None, order: Sequence[str]
    ) -> None:
        self._catalog = catalog
        self._loaded = loaded
        self._placement = placement
        self._order = order
        self._turn = 0  # place in the order of the first map that is not decided
        self._decided: set[str] = set()
        self._reserved: dict[str, int] = {}  # bytes, by map, of the loads that were given room
        self._is_full = False
        self._changed = threading.Condition()

    def take_room(self, map_id: str, version: str) -> bool:
        """Reserve room for a map if it fits without an eviction; unheld maps may be evicted for held ones.

        Raises:
            NotFound, VersionError, StoreError: see ``Catalog.manifest``.
        """
        if self._is_full or (self._placement is not None and map_id not in self._placement):
            return False
        protected = self._placement is not None
        if not self._loaded.has_room(1, 1, protected=protected):  # saves a request to the store
            self._is_full = True
            return False
        need_bytes = self._catalog.manifest(map_id, version).query_bytes
        with self._changed:
            while not self._is_full and self._order[self._turn] != map_id:
                self._changed.wait()
            # A reserved load may be in memory already and count twice. So near the limit, wait for its end.
            while not self._is_full:
                versions, size_bytes = len(self._reserved) + 1, sum(self._reserved.values()) + need_bytes
                if self._loaded.has_room(versions, size_bytes, protected=protected):
                    self._reserved[map_id] = need_bytes
                    return True
                if self._reserved:
                    self._changed.wait()
                else:
                    self._is_full = True
                    self._changed.notify_all()
        return False

    def decided(self, map_id: str) -> None:
        """Record that it is known whether the map will be loaded: the next map may take room."""
        with self._changed:
            self._decided.add(map_id)
            while self._turn < len(self._order) and self._order[self._turn] in self._decided:
                self._turn += 1
            self._changed.notify_all()

    def load_ended(self, map_id: str) -> None:
        """Give back the reservation of the map, if it has one."""
        with self._changed:
            self._reserved.pop(map_id, None)
        self.decided(map_id)
