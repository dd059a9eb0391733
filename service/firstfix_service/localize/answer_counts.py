"""How many queries of each map were answered in the last hour and day, and how many were localized."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

HOUR_S, DAY_S = 3600.0, 86400.0
STEP_S = 300.0  # answers are counted together for so long: an hour is told to within it
MAX_MAPS = 2000  # in memory; the counts of the map that was asked longest ago are dropped


@dataclass(frozen=True)
class Counted:
    """Answers within a time."""

    answered: int = 0
    localized: int = 0


@dataclass(frozen=True)
class MapCounts:
    """Answers about one map.

    Attributes:
        last_age_s: time since the last answer.
    """

    map_id: str
    last_age_s: float
    hour: Counted
    day: Counted


@dataclass
class _Steps:
    last_s: float = 0.0
    counts: dict[int, list[int]] = field(default_factory=dict)  # step: [answered, localized]


class AnswerCounts:
    """Counts of this replica's answers. Thread-safe. They begin when it starts.

    Args:
        clock: monotonic time in seconds.
        make_late: counts the answers that still wait for it (``LateCounts``).
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, make_late: Callable[[], None] = lambda: None
    ) -> None:
        self._clock = clock
        self._make_late = make_late
        self._maps: OrderedDict[str, _Steps] = OrderedDict()
        self._lock = threading.Lock()

    def add(self, map_id: str, is_localized: bool, given_s: float) -> None:
        """Count an answer.

        Args:
            given_s: time of the clock when it was given.
        """
        step = int(given_s // STEP_S)
        with self._lock:
            steps = self._maps.get(map_id)
            if steps is None:
                steps = self._maps[map_id] = _Steps()
            self._maps.move_to_end(map_id)
            steps.last_s = given_s
            counted = steps.counts.get(step)
            if counted is None:
                for old in [one for one in steps.counts if one <= step - DAY_S // STEP_S]:
                    del steps.counts[old]
                counted = steps.counts[step] = [0, 0]
            counted[0] += 1
            counted[1] += is_localized
            if len(self._maps) > MAX_MAPS:
                self._maps.popitem(last=False)

    def of_maps(self) -> list[MapCounts]:
        """The counts of all maps that were asked, by their ids."""
        self._make_late()
        now_s = self._clock()
        with self._lock:
            map_ids = sorted(self._maps)
        found = []
        for map_id in map_ids:
            with self._lock:  # of each map anew: the event loop counts answers meanwhile
                steps = self._maps.get(map_id)
                if steps is None:
                    continue
                hour, day = _within(steps, now_s, HOUR_S), _within(steps, now_s, DAY_S)
                found.append(MapCounts(map_id, max(0.0, now_s - steps.last_s), hour, day))
        return found


def _within(steps: _Steps, now_s: float, length_s: float) -> Counted:
    first = int(now_s // STEP_S) - length_s // STEP_S
    found = [counted for step, counted in steps.counts.items() if step > first]
    return Counted(sum(answered for answered, _ in found), sum(localized for _, localized in found))
