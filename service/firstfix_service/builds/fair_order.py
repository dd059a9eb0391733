"""Order of waiting builds: owners take turns, so that many builds of one do not delay the others."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

from .unfinished import UnfinishedBuild

MAX_OWNERS = 10_000  # the owner whose turn is longest ago is forgotten first


class FairOrder:
    """Round-robin over owners; the oldest build of an owner comes first. For use by one event loop."""

    def __init__(self) -> None:
        self._served: OrderedDict[str, None] = OrderedDict()  # owners that had a turn, the latest one last

    def sort(self, builds: Sequence[UnfinishedBuild]) -> list[UnfinishedBuild]:
        """Returns the first build of each owner, then the second build of each owner, and so on.

        Within such a round, owners without a turn yet come first, by the age of their builds, then the others
        by the time since their last turn.

        Args:
            builds: oldest first. Running builds count for the rounds of their owners.
        """
        last_turn = {owner: number for number, owner in enumerate(self._served)}
        rounds: dict[str, int] = {}
        ranked = []
        for age, build in enumerate(builds):
            owner_round = rounds[build.owner] = rounds.get(build.owner, -1) + 1
            ranked.append((owner_round, last_turn.get(build.owner, -1), age, build))
        return [build for *_, build in sorted(ranked, key=lambda item: item[:3])]

    def had_turn(self, owner: str) -> None:
        """Records that the owner had a turn now."""
        self._served[owner] = None
        self._served.move_to_end(owner)
        while len(self._served) > MAX_OWNERS:
            self._served.popitem(last=False)
