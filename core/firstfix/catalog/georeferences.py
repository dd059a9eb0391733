"""Georeferences of the maps in a store: numbered records, of which the last one is valid.

    maps/<map_id>/georeference/000001.json    created once: a georeference, or null if it was removed

A georeference belongs to the map, not to a version: all versions of a map are in one frame.
"""

from __future__ import annotations

import re
from typing import Any

from ..errors import StoreUnavailable
from ..ids import check_map_id
from ..store.json_record import RecordKind, read_record, record_json
from ..store.store import Store
from .geopose import Georeference

_RECORD_NAME = re.compile(r"(\d{6,})\.json")
_MAX_RACES = 50


class Georeferences:
    """Georeferences by map. Thread-safe. Every method raises InvalidOption for an invalid id."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def get(self, map_id: str) -> Georeference | None:
        """Valid georeference of a map, or None.

        Raises:
            UnreadableRecord: the last record is damaged. The one before does not become valid again, because
                a pose at a wrong place is worse than none.
        """
        last = self._last(map_id)
        if not last:
            return None
        return read_record(self._store, _key(map_id, last), RecordKind.GEOREFERENCE, parse_georeference)

    def set(self, map_id: str, georeference: Georeference | None) -> None:
        """Set the georeference of a map; None removes it.

        If two are set at the same time, the one with the higher number is valid.
        """
        data = b"null" if georeference is None else record_json(georeference.to_mapping())
        for _ in range(_MAX_RACES):
            if self._store.put_new(_key(map_id, self._last(map_id) + 1), data):
                return
        raise StoreUnavailable(f"map {map_id}: {_MAX_RACES} races for a georeference lost in a row")

    def _last(self, map_id: str) -> int:
        """Number of the last record; 0 if there is none."""
        names = [key.rsplit("/", 1)[-1] for key in self._store.list(_folder(map_id))]
        return max((int(match[1]) for name in names if (match := _RECORD_NAME.fullmatch(name))), default=0)


def parse_georeference(record: dict[str, Any] | None) -> Georeference | None:
    """Parse a record.

    Raises:
        InvalidOption: it is not a georeference.
    """
    return None if record is None else Georeference.from_mapping(record)


def _folder(map_id: str) -> str:
    return f"maps/{check_map_id(map_id)}/georeference"


def _key(map_id: str, number: int) -> str:
    return f"{_folder(map_id)}/{number:06d}.json"
