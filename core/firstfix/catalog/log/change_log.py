"""Notices of changed maps for the whole store, so that a reader of thousands of maps polls one object.

    changes/00000001.json, ...           id of a map; created once and without gaps, like a map's log
    changes/marks/00000500.json, ...     empty objects: there are notices up to this number

A notice is only a hint where to look; the map's own log is the truth. A notice can be missing, because its
writer was killed or the store failed, or have a number that was collected, because its writer was stopped for
a day. Then a reader sees the change when it next looks at every map. The marks tell where to begin, so that
old notices can be collected (``firstfix.catalog.log.log_garbage``).
"""

from __future__ import annotations

import threading
from typing import Any

from ...errors import NotFound, UnreadableRecord
from ...ids import check_map_id
from ...store.json_record import READERS, RecordKind, read_each, read_record, record_json, text_of
from ...store.numbered import scan_after
from ...store.store import Store

FOLDER = "changes"
MARKS = f"{FOLDER}/marks"
DIGITS = 8
MARK_EVERY = 500  # notices
_MAX_AT_ONCE = 1000  # notices that one call reads


class ChangeLog:
    """Notices of changes in a store. Thread-safe."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._last = 0  # the highest number seen here
        self._lock = threading.Lock()

    def note(self, map_id: str) -> None:
        """Put a notice that the map's log has a new entry.

        Raises:
            StoreUnavailable, StoreError: the store failed.
        """
        content = notice_json(check_map_id(map_id))
        number = self.end() + 1
        while not self._store.put_new(_key(number), content):
            number += 1  # another writer has this number
        if number % MARK_EVERY == 0:
            self._store.put_new(f"{MARKS}/{number:0{DIGITS}d}.json", b"")

    def end(self) -> int:
        """Number of the last notice; 0 if there is none.

        A search by doubling and halving from the last mark: few calls, however many notices there are.
        """
        with self._lock:
            low = self._last
        if not low or not self._store.exists(_key(low)):  # first call, or the notices were removed
            low = max(scan_after(self._store, MARKS, 0, digits=DIGITS), default=0)
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
        """Map with notices after a number, each once, in order; and the last number read.

        One call to the store if there is nothing new.
        """
        map_ids: dict[str, None] = {}
        begin, at_once = number, 1
        while number - begin < _MAX_AT_ONCE:
            found = read_each(range(number + 1, number + 1 + at_once), self._read)
            there = [map_id for map_id in found.values() if map_id is not None]
            map_ids.update(dict.fromkeys(filter(None, there)))
            number += len(there)
            if len(there) < at_once:
                break
            at_once = READERS
        return list(map_ids), number

    def go_on_from(self, number: int) -> int:
        """Number from which a reader continues after it looked at every map.

        Its own number; or the last one, if notices in between were collected or all were removed.
        """
        end = self.end()
        return number if number < end and self._store.exists(_key(number + 1)) else end

    def _read(self, number: int) -> str | None:
        """Map id in a notice; empty if it is damaged or void; None if there is no such notice."""
        try:
            return read_record(self._store, _key(number), RecordKind.CHANGE_NOTICE, parse_notice)
        except UnreadableRecord:
            return ""
        except NotFound:
            return None


def notice_json(map_id: str | None) -> bytes:
    """Content of a notice; without a map it is void."""
    return record_json({"map_id": map_id})


def parse_notice(record: dict[str, Any]) -> str:
    """Map id in a notice's record; empty if the notice is void.

    Raises:
        KeyError, TypeError, InvalidOption: it is not a notice.
    """
    return "" if record["map_id"] is None else check_map_id(text_of(record, "map_id"))


def _key(number: int) -> str:
    return f"{FOLDER}/{number:0{DIGITS}d}.json"
