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
        self._callers, self._maps = _Names(clock), _Names(clock)

    def is_slow(self, expected_s: float) -> bool:
        """Whether a query counts as slow, beside others that are not."""
        return self._workers > 1 and expected_s > Limits.slow_query_s

    def may_begin(self, asker: Asker) -> bool:
        """Whether another slow query of this caller and map leaves a worker to the others."""
        return all(
            names.slow.get(name, 0) < self._workers - 1 or not names.has_others(name)
            for names, name in self._both(asker)
        )

    def entered(self, asker: Asker) -> None:
        """Note that a query came into the gate."""
        for names, name in self._both(asker):
            names.present[name] = names.present.get(name, 0) + 1

    def left(self, asker: Asker) -> None:
        """Note that a query left the gate."""
        for names, name in self._both(asker):
            _take_one(names.present, name)

    def began(self, asker: Asker, is_slow: bool) -> None:
        """Note that a worker has a query."""
        for names, name in self._both(asker):
            names.answered_now(name)
            if is_slow:
                names.slow[name] = names.slow.get(name, 0) + 1

    def ended(self, asker: Asker, is_slow: bool) -> None:
        """Note that the worker has answered."""
        for names, name in self._both(asker):
            names.answered_now(name)
            if is_slow:
                _take_one(names.slow, name)

    def _both(self, asker: Asker) -> tuple[tuple[_Names, str], tuple[_Names, str]]:
        return (self._callers, asker.caller), (self._maps, asker.map_id)


def _take_one(counts: dict[str, int], name: str) -> None:
    left = counts.pop(name, 1) - 1
    if left:
        counts[name] = left


class _Names:
    """Callers, or maps.

    Attributes:
        present: number of queries in the gate.
        slow: number of slow queries that run.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._answered: OrderedDict[str, float] = OrderedDict()  # when; the latest last
        self.present: dict[str, int] = {}
        self.slow: dict[str, int] = {}

    def answered_now(self, name: str) -> None:
        """Note that a query of this name runs. Names that are never answered may be invented."""
        self._answered[name] = self._clock()
        self._answered.move_to_end(name)
        if len(self._answered) > _MAX_NAMES:
            self._answered.popitem(last=False)

    def has_others(self, name: str) -> bool:
        """Whether another name has a query in the gate, or was answered lately."""
        if len(self.present) > (name in self.present):
            return True
        since = self._clock() - Limits.recent_s
        return any(other != name and then > since for other, then in self._answered.items())
