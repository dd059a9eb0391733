"""Order of waiting builds: callers take turns, so that one who hands in many does not hold up the others."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

from .unfinished import Unfinished

OWNERS_KEPT = 10_000  # one that is forgotten had its turn long ago


class FairOrder:
    """Round-robin over the builds' owners; of one owner the oldest build first. One event loop's."""

    def __init__(self) -> None:
        self._served: OrderedDict[str, None] = OrderedDict()  # owners who had a turn, the last one last

    def of(self, builds: Sequence[Unfinished]) -> list[Unfinished]:
        """Every owner's first build, then every owner's second one, and so on; within such a round first
        those who had no turn yet, by the age of their build, then those whose last turn is longest ago.

        Args:
            builds: the oldest first. Those that run count for their owners' rounds.
        """
        turn = {owner: number for number, owner in enumerate(self._served)}
        seen: dict[str, int] = {}
        ranked = []
        for age, build in enumerate(builds):
            owner_round = seen[build.owner] = seen.get(build.owner, -1) + 1
            ranked.append((owner_round, turn.get(build.owner, -1), age, build))
        return [build for *_, build in sorted(ranked, key=lambda item: item[:3])]

    def served(self, owner: str) -> None:
        """The owner had a turn."""
        self._served[owner] = None
        self._served.move_to_end(owner)
        while len(self._served) > OWNERS_KEPT:
            self._served.popitem(last=False)
