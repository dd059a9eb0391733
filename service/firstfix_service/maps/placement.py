"""Placement of maps on replicas: which maps this replica holds.

A map's holders are the first few replicas by rendezvous hashing. A holder loads its maps before they are
queried and evicts them last. Every replica answers for any map, so nothing fails while replicas disagree
about who is alive.
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
class PlacementChange:
    """Effect of a new set of replicas on this replica.

    Attributes:
        changed: maps that this replica now holds and did not, or the reverse, or holds by another rank.
        gained: those of them that it did not hold before.
    """

    changed: set[str]
    gained: set[str]


class Placement:
    """The maps that this replica holds. Thread-safe; a look-up takes no lock and no hashing.

    Args:
        replica: name of this replica.
        copies: number of replicas that hold each map.
    """

    def __init__(self, replica: str, copies: int) -> None:
        self.copies = copies
        self._replica = replica
        self._replicas = frozenset({replica})
        self._ranks: dict[str, int] = {}  # of the held maps; replaced, never changed
        self._all_maps: set[str] = set()
        self._changing = threading.Lock()

    @property
    def replicas(self) -> list[str]:
        """Names of all replicas, with this one, sorted."""
        return sorted(self._replicas)

    @property
    def maps(self) -> Set[str]:
        """The held maps."""
        return self._ranks.keys()

    def __len__(self) -> int:
        return len(self._ranks)

    def __contains__(self, map_id: object) -> bool:
        return map_id in self._ranks

    def is_first_holder(self, map_id: str) -> bool:
        """Whether this replica is the map's first holder."""
        return self._ranks.get(map_id) == 0

    def sorted_by_rank(self, map_ids: Iterable[str]) -> list[str]:
        """The maps sorted by this replica's rank among their holders; unheld maps come last."""
        ranks = self._ranks
        return sorted(map_ids, key=lambda map_id: (ranks.get(map_id, self.copies), map_id))

    def summary(self, loaded: int) -> dict[str, Any]:
        """The placement as /readyz shows it.

        Args:
            loaded: number of held maps that are in memory.
        """
        return {"copies": self.copies, "replicas": len(self.replicas), "maps": len(self), "loaded": loaded}

    def set_replicas(self, replicas: Iterable[str]) -> PlacementChange:
        """Place all maps anew on these replicas and this one."""
        with self._changing:
            self._replicas = frozenset(replicas) | {self._replica}
            before, self._ranks = self._ranks, self._held_ranks(self._all_maps)
            after = self._ranks
        changed = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
        return PlacementChange(changed, changed - before.keys())

    def add_maps(self, map_ids: Iterable[str]) -> None:
        """Places new maps. Known maps are ignored."""
        with self._changing:
            new = set(map_ids) - self._all_maps
            self._all_maps |= new
            if held := self._held_ranks(new):
                self._ranks = self._ranks | held

    def remove_map(self, map_id: str) -> None:
        """Remove a map from the placement."""
        with self._changing:
            self._all_maps.discard(map_id)
            if map_id in self._ranks:
                self._ranks = {name: own for name, own in self._ranks.items() if name != map_id}

    def _held_ranks(self, map_ids: Iterable[str]) -> dict[str, int]:
        ranks = ((map_id, rank(map_id, self._replica, self._replicas)) for map_id in map_ids)
        return {map_id: own_rank for map_id, own_rank in ranks if own_rank < self.copies}


def open_placement(settings: Settings, replica: str) -> Placement | None:
    """The placement that the settings ask for; None if replicas do not share the maps.

    Raises:
        InvalidOption: the settings do not say who the replicas are, or which of them this is.
    """
    names = settings.replica_names
    if not settings.holders:
        if names:
            raise InvalidOption("FIRSTFIX_REPLICA_NAMES has no effect without FIRSTFIX_HOLDERS")
        return None
    if not names and not settings.zenoh_enabled:
        raise InvalidOption(
            "FIRSTFIX_HOLDERS needs zenoh or FIRSTFIX_REPLICA_NAMES: without them the replicas are unknown"
        )
    if names and replica not in names:
        raise InvalidOption(f"FIRSTFIX_REPLICA_NAMES does not contain FIRSTFIX_REPLICA, {replica!r}")
    placement = Placement(replica, settings.holders)
    placement.set_replicas(names)
    return placement
