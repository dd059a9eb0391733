"""Record of the files of a map that were verified lately, so that they are not read again every day.

    checked/<map_id>.json    for each key: time and ETag of its put, and the time of the check

It is only a hint: of two writers the last one wins, and if it is lost all files are read again. A file that
was put again since has another time or ETag, and is read again.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any

from ..errors import NotFound, UnreadableRecord
from ..ids import check_map_id
from ..store.json_record import RecordKind, read_record, record_json
from ..store.store import Store, StoredObject

FOLDER = "checked"


class CheckedObjects:
    """Verified files of one map. Not thread-safe.

    Raises:
        StoreUnavailable, StoreError: the store failed.
    """

    def __init__(self, store: Store, map_id: str) -> None:
        self._store = store
        self._key = f"{FOLDER}/{check_map_id(map_id)}.json"
        self._changed = False
        self._now = store.now()  # for the whole round: only days matter
        try:
            self._checked = read_record(store, self._key, RecordKind.CHECKED_OBJECTS, parse_checked)
        except (NotFound, UnreadableRecord):
            self._checked = {}

    def is_fresh(self, item: StoredObject, max_age: timedelta) -> bool:
        """Whether the object was verified within ``max_age`` and not put again since."""
        put, checked = self._checked.get(item.key, ("", ""))
        if put != _put_of(item):
            return False
        age = self._now - datetime.fromisoformat(checked)
        return timedelta() <= age < max_age

    def note(self, item: StoredObject) -> None:
        """Note that the object is verified now."""
        self._checked[item.key] = (_put_of(item), self._now.isoformat())
        self._changed = True

    def drop(self, key: str) -> None:
        """Forget an object that is damaged or gone."""
        self._changed |= self._checked.pop(key, None) is not None

    def save(self, kept: set[str]) -> None:
        """Put the record if it changed, with these keys only."""
        for key in self._checked.keys() - kept:
            self.drop(key)
        if self._changed:
            self._store.put(self._key, record_json({"checked": self._checked}))
            self._changed = False


def parse_checked(record: dict[str, Any]) -> dict[str, tuple[str, str]]:
    """Parse the record.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: it is not what ``save`` puts.
    """
    checked = {str(key): (str(put), str(time)) for key, (put, time) in record["checked"].items()}
    for _, time in checked.values():
        if datetime.fromisoformat(time).tzinfo is None:
            raise ValueError("a time has no zone")
    return checked


def _put_of(item: StoredObject) -> str:
    return f"{item.last_modified.astimezone(timezone.utc).isoformat()} {item.e_tag}"
