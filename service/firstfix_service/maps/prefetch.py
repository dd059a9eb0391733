"""Maps that are loaded before anybody asks for them: each once, while there is room; where replicas share the
maps those that are held here."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

from firstfix.catalog.catalog import Catalog

from .loaded_versions import ResidentVersions
from .placement import Holding

THREADS = 8
FEW = 16  # maps that are not worth threads


class LoadAhead:
    """What was loaded ahead so far. Thread-safe."""

    def __init__(self, catalog: Catalog, resident: ResidentVersions, holding: Holding | None) -> None:
        self._catalog = catalog
        self._resident = resident
        self._holding = holding
        self._lock = threading.Lock()
        self._settled: set[str] = set()
        self._stop = threading.Event()

    def is_settled(self, map_id: str) -> bool:
        """Whether the map was loaded, or there was no room, or it cannot be loaded."""
        return map_id in self._settled

    def begin_again(self, map_ids: Iterable[str]) -> None:
        """These are to be loaded ahead once more."""
        with self._lock:
            self._settled.difference_update(map_ids)

    def held_and_not_settled(self) -> list[str]:
        held = () if self._holding is None else self._holding.maps
        return [map_id for map_id in held if map_id not in self._settled]

    def stop(self) -> None:
        """Rounds end with what they have begun."""
        self._stop.set()

    def see_to(
        self, map_ids: Iterable[str], see_to: Callable[[str, Round], bool], superseded: Callable[[], bool]
    ) -> None:
        """One round, for many maps in threads; where there may be no room for all the most important first.

        Args:
            see_to: loads a map, if it is to be; False: it should be tried again in another round.
            superseded: whether the round is to end.
        """
        names = sorted(map_ids) if self._holding is None else self._holding.in_order(map_ids)
        this = Round(self._catalog, self._resident, self._holding, names)

        def one(map_id: str) -> None:
            try:
                if superseded() or self._stop.is_set():
                    return
                is_settled = see_to(map_id, this)
            finally:
                this.ended(map_id)
            if is_settled and (self._holding is None or map_id in self._holding):
                with self._lock:
                    self._settled.add(map_id)

        if len(names) <= FEW:
            for name in names:
                one(name)
            return
        with ThreadPoolExecutor(THREADS, thread_name_prefix="map-ahead") as threads:
            list(threads.map(one, names))


class Round:
    """Room, until there is none for one of the maps: each gets it after those that stand before it in the
    order, whichever thread is quicker. Thread-safe.

    Args:
        order: of the maps, the most important first. Their threads begin in this order.
    """

    def __init__(
        self, catalog: Catalog, resident: ResidentVersions, holding: Holding | None, order: Sequence[str]
    ) -> None:
        self._catalog = catalog
        self._resident = resident
        self._holding = holding
        self._order = order
        self._turn = 0  # the place in the order of the first map that is not decided
        self._decided: set[str] = set()
        self._given: dict[str, int] = {}  # bytes of the maps that are being loaded, or soon will be
        self._is_full = False
        self._changed = threading.Condition()

    def has_room(self, map_id: str, version: str) -> bool:
        """For a map to be loaded ahead, without another one having to go; what is not held goes for what is.

        Raises:
            NotFound, VersionError, StoreError: as ``Catalog.manifest``.
        """
        if self._is_full or (self._holding is not None and map_id not in self._holding):
            return False
        kept = self._holding is not None
        if not self._resident.has_room(1, 1, kept=kept):  # then the store need not be asked
            self._is_full = True
            return False
        need = self._catalog.manifest(map_id, version).total_bytes
        with self._changed:
            while not self._is_full and self._order[self._turn] != map_id:
                self._changed.wait()
            # What was given room may be in memory by now and counted twice: at the limit it is waited for.
            while not self._is_full:
                versions, size = len(self._given) + 1, sum(self._given.values()) + need
                if self._resident.has_room(versions, size, kept=kept):
                    self._given[map_id] = need
                    return True
                if self._given:
                    self._changed.wait()
                else:
                    self._is_full = True
                    self._changed.notify_all()
        return False

    def decided(self, map_id: str) -> None:
        """Whether the map is to be loaded is known: the next one's turn."""
        with self._changed:
            self._decided.add(map_id)
            while self._turn < len(self._order) and self._order[self._turn] in self._decided:
                self._turn += 1
            self._changed.notify_all()

    def ended(self, map_id: str) -> None:
        """The map's load, if there was one."""
        with self._changed:
            self._given.pop(map_id, None)
        self.decided(map_id)
