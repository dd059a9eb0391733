"""Selects the maps whose logs are read at each poll, and reads them.

A poll reads the change notices and the logs of the maps that they name. A notice can be lost, so a few other
maps are read at each poll too: every map is read once in ``sweep_s``. No more than ``MAX_LOGS_PER_S`` logs
are read for this, so with thousands of maps a sweep takes longer.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_state import MapState
from firstfix.errors import FirstfixError

_log = structlog.get_logger(__name__)
# A lost notice is rare, and stores charge for requests: 10,000 maps are read in an hour.
SWEEP_INTERVAL_S, MAX_LOGS_PER_S = 60.0, 3
READERS = 16  # logs read at the same time


class CatalogWatch:
    """Change notices of the catalog, and a slow sweep over all maps. For use by one thread.

    Args:
        interval_s: time between polls.
        sweep_s: time in which every map is read once, if there are few enough maps.
    """

    def __init__(self, catalog: Catalog, *, interval_s: float, sweep_s: float) -> None:
        self._catalog = catalog
        self._polls_per_sweep = max(1.0, sweep_s / interval_s)
        self._max_swept = math.ceil(MAX_LOGS_PER_S * interval_s)
        self._position: int | None = None  # last notice that was read; None before the first poll
        self._names: list[str] = []
        self._sweep: deque[str] = deque()

    def poll(self) -> tuple[list[str], frozenset[str] | None]:
        """The maps to read now and, if the maps were listed again, the names of all maps.

        Raises:
            StoreUnavailable, StoreError: the store failed. The next poll catches up.
        """
        if self._position is None:
            position = self._catalog.changes.end()  # before the maps are listed, or a change could be missed
            self._names = self._catalog.folder_names()
            self._position = position
            return list(self._names), frozenset(self._names)
        named, self._position = self._catalog.changes.since(self._position)
        listed = None
        if not self._sweep:
            new = self._begin_sweep()
            listed = frozenset(self._names)
            named.extend(new)
        swept = min(math.ceil(len(self._names) / self._polls_per_sweep), self._max_swept)
        named.extend(self._sweep.popleft() for _ in range(min(swept, len(self._sweep))))
        return list(dict.fromkeys(named)), listed

    def reset(self) -> None:
        """Make the next poll return all maps."""
        self._position = None
        self._sweep.clear()

    def _begin_sweep(self) -> list[str]:
        """List the maps and return the new ones."""
        assert self._position is not None
        # Old notices may have been collected.
        self._position = self._catalog.changes.go_on_from(self._position)
        names = self._catalog.folder_names()
        new = sorted(set(names) - set(self._names))
        self._names = names
        self._sweep.extend(names)
        return new


def read_states(catalog: Catalog, map_ids: Sequence[str], *, strict: bool) -> dict[str, MapState]:
    """The states of maps by their ids.

    Args:
        strict: raise the error of a map that cannot be read, and always read in parallel. Otherwise such a
            map is left out and logged.

    Raises:
        FirstfixError: only if ``strict``.
    """

    def read(map_id: str) -> MapState | None:
        try:
            return catalog.state(map_id)
        except FirstfixError as error:
            if strict:
                raise
            _log.warning("cannot read a map's log", map_id=map_id, code=error.code, error=str(error))
            return None

    if len(map_ids) < READERS and not strict:
        states = [read(map_id) for map_id in map_ids]
    else:
        with ThreadPoolExecutor(READERS, thread_name_prefix="map-reader") as threads:
            states = list(threads.map(read, map_ids))
    return {name: state for name, state in zip(map_ids, states, strict=True) if state is not None}
