"""Which maps changed, for the whole store: so that a reader of thousands of maps asks for one object.

    changes/00000001.json, ...     a map's id; create-only and without gaps, as a map's log is

A notice is only a hint of where to look: what holds is the map's own log. One that was never written,
as its writer was killed just before or the store failed, delays a reader until its next look at every map.
"""

from __future__ import annotations

import json
import threading

from .errors import FirstfixError, NotFound
from .ids import check_map_id
from .store import Store

_FOLDER = "changes"
_MAX_AT_ONCE = 1000  # notices that one look reads


class ChangeLog:
    """Thread-safe."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._last = 0  # the highest number seen here
        self._lock = threading.Lock()

    def note(self, map_id: str) -> None:
        """Says that the map's log has a new entry.

        Raises:
            StoreUnavailable, StoreError: as the store.
        """
        content = json.dumps({"map_id": check_map_id(map_id)}).encode("ascii")
        number = self.end() + 1
        while not self._store.put_new(_key(number), content):
            number += 1  # somebody else's

    def end(self) -> int:
        """Number of the last notice; 0 where there is none. It is looked for by doubling and halving:
        a few calls, however many notices there are."""
        with self._lock:
            low = self._last
        if low and not self._store.exists(_key(low)):  # somebody removed them
            low = 0
        step = 1
        while self._store.exists(_key(low + step)):
            low, step = low + step, step * 2
        while step > 1:
            step //= 2
            if self._store.exists(_key(low + step)):
                low += step
        with self._lock:
            self._last = low
        return low

    def since(self, number: int) -> tuple[list[str], int]:
        """The maps of the notices after that number, each once in their order, and the last number read.
        One call to the store where there is nothing new."""
        map_ids: dict[str, None] = {}
        for _ in range(_MAX_AT_ONCE):
            try:
                data = self._store.get(_key(number + 1))
            except NotFound:
                break
            number += 1
            try:
                map_ids[check_map_id(json.loads(data)["map_id"])] = None
            except (ValueError, KeyError, TypeError, FirstfixError):
                continue  # of a later firstfix
        return list(map_ids), number


def _key(number: int) -> str:
    return f"{_FOLDER}/{number:08d}.json"
