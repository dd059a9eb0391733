"""Which maps this replica holds: those for which it is among the first few of the replicas that there are,
by rendezvous hashing.

What is held is loaded ahead of its queries and put out last. It is no more than that: a replica answers
from any map, so while replicas see each other differently nothing fails.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Set
from dataclasses import dataclass
from typing import Any

from firstfix.catalog.rendezvous import rank
from firstfix.errors import InvalidOption

from ..settings import Settings


@dataclass(frozen=True)
class Moved:
    """Attributes:
    changed: maps that are held now and were not, or the reverse, or by another rank.
    come: those of them that were not held.
    """

    changed: set[str]
    come: set[str]


class Holding:
    """Thread-safe. To ask whether a map is held takes no lock and no hashing.

    Args:
        replica: the name of this one.
        copies: how many replicas hold each map.
    """

    def __init__(self, replica: str, copies: int) -> None:
        self.copies = copies
        self._replica = replica
        self._replicas = frozenset({replica})
        self._ranks: dict[str, int] = {}  # of the maps that are held; replaced, never changed
        self._known: set[str] = set()  # all maps
        self._changing = threading.Lock()

    @property
    def replicas(self) -> list[str]:
        """All that there are, this one among them, in order."""
        return sorted(self._replicas)

    @property
    def maps(self) -> Set[str]:
        """Those that are held."""
        return self._ranks.keys()

    def __len__(self) -> int:
        return len(self._ranks)

    def __contains__(self, map_id: object) -> bool:
        return map_id in self._ranks

    def is_first(self, map_id: str) -> bool:
        """Whether this replica is the map's first holder."""
        return self._ranks.get(map_id) == 0

    def in_order(self, map_ids: Iterable[str]) -> list[str]:
        """Those first that this replica is the first holder of, then the second, ...; the others last."""
        ranks = self._ranks
        return sorted(map_ids, key=lambda map_id: (ranks.get(map_id, self.copies), map_id))

    def described(self, loaded: int) -> dict[str, Any]:
        """For people who look.

        Args:
            loaded: how many of the maps that are held are in memory.
        """
        return {"copies": self.copies, "replicas": len(self.replicas), "maps": len(self), "loaded": loaded}

    def see(self, replicas: Iterable[str]) -> Moved:
        """Takes these, and this one, for the replicas that there are."""
        with self._changing:
            self._replicas = frozenset(replicas) | {self._replica}
            before, self._ranks = self._ranks, self._ranked(self._known)
            after = self._ranks
        changed = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
        return Moved(changed, changed - before.keys())

    def know(self, map_ids: Iterable[str]) -> None:
        """These are maps too."""
        with self._changing:
            new = set(map_ids) - self._known
            self._known |= new
            if come := self._ranked(new):
                self._ranks = self._ranks | come

    def forget(self, map_id: str) -> None:
        with self._changing:
            self._known.discard(map_id)
            if map_id in self._ranks:
                self._ranks = {name: place for name, place in self._ranks.items() if name != map_id}

    def _ranked(self, map_ids: Iterable[str]) -> dict[str, int]:
        ranks = ((map_id, rank(map_id, self._replica, self._replicas)) for map_id in map_ids)
        return {map_id: place for map_id, place in ranks if place < self.copies}


def open_holding(settings: Settings, replica: str) -> Holding | None:
    """As the settings say; None: replicas share nothing.

    Raises:
        InvalidOption: the settings do not say who the replicas are, or who this one is.
    """
    names = settings.replica_names
    if not settings.holders:
        if names:
            raise InvalidOption("FIRSTFIX_REPLICA_NAMES is of no use without FIRSTFIX_HOLDERS")
        return None
    if not names and not settings.zenoh_enabled:
        raise InvalidOption("FIRSTFIX_HOLDERS needs zenoh, or FIRSTFIX_REPLICA_NAMES: who are the replicas?")
    if names and replica not in names:
        raise InvalidOption(f"FIRSTFIX_REPLICA_NAMES does not have FIRSTFIX_REPLICA, {replica!r}")
    holding = Holding(replica, settings.holders)
    holding.see(names)
    return holding
