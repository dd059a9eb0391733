"""Which maps to look at: those that a notice names, and all of them in turn, a few at a time.

One look asks the store for one object where nothing changed, and for the logs of a few maps: so many that
each map has had its turn after ``sweep_s``, as a notice may be lost; but no more than ``LOGS_A_SECOND``,
however many maps there are: with thousands a turn takes longer.
"""

from __future__ import annotations

import math
from collections import deque

from firstfix.catalog.catalog import Catalog

LOGS_A_SECOND = 10


class CatalogWatch:
    """For one thread."""

    def __init__(self, catalog: Catalog, *, interval_s: float, sweep_s: float) -> None:
        """
        Args:
            interval_s: between looks.
            sweep_s: until every map was looked at, where there are few enough.
        """
        self._catalog = catalog
        self._looks_a_sweep = max(1.0, sweep_s / interval_s)
        self._most = math.ceil(LOGS_A_SECOND * interval_s)
        self._position: int | None = None  # last notice that was read; None before the first look
        self._names: list[str] = []
        self._turns: deque[str] = deque()

    def look(self) -> tuple[list[str], frozenset[str] | None]:
        """Maps to look at now; and when all were listed again: their names.

        Raises:
            StoreUnavailable, StoreError: as the store. The next look makes up for it.
        """
        if self._position is None:
            position = self._catalog.changes.end()  # before the maps are read, or one could slip through
            self._names = self._catalog.folder_names()
            self._position = position
            return list(self._names), frozenset(self._names)
        named, self._position = self._catalog.changes.since(self._position)
        listed = None
        if not self._turns:
            new = self._list_again()
            listed = frozenset(self._names)
            named.extend(new)
        few = min(math.ceil(len(self._names) / self._looks_a_sweep), self._most)
        named.extend(self._turns.popleft() for _ in range(min(few, len(self._turns))))
        return list(dict.fromkeys(named)), listed

    def start_again(self) -> None:
        """The next look is at all maps at once."""
        self._position = None
        self._turns.clear()

    def _list_again(self) -> list[str]:
        """Returns the maps that are new."""
        assert self._position is not None
        self._position = self._catalog.changes.go_on_from(self._position)  # some may have been collected
        names = self._catalog.folder_names()
        new = sorted(set(names) - set(self._names))
        self._names = names
        self._turns.extend(names)
        return new
