"""The share of the workers that slow queries may have, so that quick ones need not wait."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from .asker import Asker
from .limits import Limits

_MAX_NAMES = 2  # of those who were answered last: one of them is somebody else


class SlowShare:
    """Slow queries that run, by caller and by map. For use by one event loop.

    A slow query leaves one worker to the other callers, if there are any, and one to the other maps.
    """

    def __init__(self, workers: int, clock: Callable[[], float]) -> None:
        self._workers = workers
        self._clock = clock
        self._names = _Names(), _Names()  # of callers and of maps

    def is_slow(self, expected_s: float) -> bool:
        """Whether a query counts as slow, beside others that are not."""
        return self._workers > 1 and expected_s > Limits.slow_query_s

    def may_begin(self, asker: Asker) -> bool:
        """Whether another slow query of this caller and map leaves a worker to the others."""
        since = self._clock() - Limits.recent_s
        return all(
            names.slow.get(name, 0) < self._workers - 1 or not names.has_others(name, since)
            for names, name in zip(self._names, asker, strict=True)
        )

    def entered(self, asker: Asker) -> None:
        """Note that a query came into the gate."""
        for names, name in zip(self._names, asker, strict=True):
            names.present[name] = names.present.get(name, 0) + 1

    def left(self, asker: Asker) -> None:
        """Note that a query left the gate."""
        for names, name in zip(self._names, asker, strict=True):
            left = names.present.pop(name) - 1
            if left:
                names.present[name] = left

    def runs(self, asker: Asker, slow: int) -> None:
        """Note that a worker has a query, or that it has answered. Other names may be invented.

        Args:
            slow: number of slow queries that run now and did not before.
        """
        now = self._clock()
        for names, name in zip(self._names, asker, strict=True):
            names.answered[name] = now
            names.answered.move_to_end(name)
            if len(names.answered) > _MAX_NAMES:
                names.answered.popitem(last=False)
            if slow:
                names.slow[name] = names.slow.get(name, 0) + slow
                if not names.slow[name]:
                    del names.slow[name]


class _Names:
    """Callers, or maps.

    Attributes:
        answered: when those were answered that were answered last; the latest last.
        present: number of queries in the gate.
        slow: number of slow queries that run.
    """

    def __init__(self) -> None:
        self.answered: OrderedDict[str, float] = OrderedDict()
        self.present: dict[str, int] = {}
        self.slow: dict[str, int] = {}

    def has_others(self, name: str, since: float) -> bool:
        """Whether another name has a query in the gate, or was answered since then."""
        if len(self.present) > (name in self.present):
            return True
        return any(other != name and then > since for other, then in self.answered.items())
