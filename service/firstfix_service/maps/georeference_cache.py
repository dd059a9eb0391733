"""Cache of georeferences, so that a query does not read the store."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass

from firstfix.catalog.geopose import MEDIA_TYPE, Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.errors import NotAcceptable, StoreUnavailable

MAX_MAPS = 1024
GEOREFERENCE_TTL_S = 5.0  # until every replica uses a changed one, as with keys; one read of an object each


@dataclass(frozen=True)
class _Entry:
    georeference: Georeference | None
    expires_at: float  # time.monotonic


class GeoreferenceCache:
    """Georeferences of maps, read again after ``ttl_s``. Thread-safe.

    While the store does not answer, expired entries stay in use.
    """

    def __init__(self, georeferences: Georeferences, ttl_s: float) -> None:
        self._georeferences = georeferences
        self._ttl_s = ttl_s
        self._entries: OrderedDict[str, _Entry] = OrderedDict()
        self._lock = threading.Lock()

    def of(self, map_id: str) -> Georeference:
        """The georeference of a map.

        Raises:
            NotAcceptable: the map has none, so its poses have no geographic form.
            InvalidOption: the map id is not valid.
            StoreError: the store failed, and there is no entry from before.
        """
        with self._lock:
            entry = self._entries.get(map_id)
        if entry is None or time.monotonic() > entry.expires_at:
            try:
                georeference = self._georeferences.get(map_id)
            except StoreUnavailable:
                if entry is None:
                    raise
                georeference = entry.georeference
            entry = _Entry(georeference, time.monotonic() + self._ttl_s)
            with self._lock:
                self._entries[map_id] = entry
                self._entries.move_to_end(map_id)
                while len(self._entries) > MAX_MAPS:
                    self._entries.popitem(last=False)
        if entry.georeference is None:
            raise NotAcceptable(f"map {map_id} has no georeference: its poses cannot be sent as {MEDIA_TYPE}")
        return entry.georeference

    def forget(self, map_id: str) -> None:
        """Remove the entry of a map whose georeference this process changed."""
        with self._lock:
            self._entries.pop(map_id, None)
