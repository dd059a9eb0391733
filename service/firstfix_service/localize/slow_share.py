"""The workers that slow queries may take: those of one caller, or of one map, never take the last one."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable

from ..query_workers.query import Asker

SLOW_S = 0.25  # a query that is expected to take longer is slow
RECENT_S = 60.0  # who was answered within this time may ask again at any moment
_MAX_NAMES = 2  # of those who were answered last: one of them is somebody else


class SlowShare:
    """Slow queries that run, by caller and by map. For use by one event loop.

    A slow query leaves one worker to the other callers, if there are any, and one to the other maps.
    """

    def __init__(self, workers: int, clock: Callable[[], float]) -> None:
        self._workers = workers
        self._callers, self._maps = _Names(clock), _Names(clock)

    def is_slow(self, expected_s: float) -> bool:
        """Returns whether a query that should take so long is slow."""
        return self._workers > 1 and expected_s > SLOW_S

    def may_begin(self, asker: Asker) -> bool:
        """Returns whether one more slow query may run."""
        return all(
            names.slow[name] < self._workers - 1 or not names.has_others(name)
            for names, name in self._both(asker)
        )

    def entered(self, asker: Asker) -> None:
        """Counts a query in the pool."""
        for names, name in self._both(asker):
            names.present[name] += 1

    def left(self, asker: Asker) -> None:
        """Ends the count of a query in the pool."""
        for names, name in self._both(asker):
            _count_down(names.present, name)

    def began(self, asker: Asker, is_slow: bool) -> None:
        """Counts a query that runs."""
        for names, name in self._both(asker):
            names.answered_now(name)
            if is_slow:
                names.slow[name] += 1

    def ended(self, asker: Asker, is_slow: bool) -> None:
        """Ends the count of a query that runs."""
        for names, name in self._both(asker):
            names.answered_now(name)
            if is_slow:
                _count_down(names.slow, name)

    def _both(self, asker: Asker) -> tuple[tuple[_Names, str], tuple[_Names, str]]:
        return (self._callers, asker.caller), (self._maps, asker.map_id)


class _Names:
    """Callers, or maps.

    Attributes:
        present: number of queries in the pool.
        slow: number of slow queries that run.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._answered: OrderedDict[str, float] = OrderedDict()  # when; the latest last
        self.present: Counter[str] = Counter()
        self.slow: Counter[str] = Counter()

    def answered_now(self, name: str) -> None:
        """Notes that a query of this name runs. Names that are never answered may be invented."""
        self._answered[name] = self._clock()
        self._answered.move_to_end(name)
        if len(self._answered) > _MAX_NAMES:
            self._answered.popitem(last=False)

    def has_others(self, name: str) -> bool:
        """Returns whether another name has a query in the pool, or was answered lately."""
        if len(self.present) > (name in self.present):
            return True
        since = self._clock() - RECENT_S
        return any(other != name and then > since for other, then in self._answered.items())


def _count_down(counter: Counter[str], name: str) -> None:
    counter[name] -= 1
    if not counter[name]:
        del counter[name]
