"""Georeferences for queries: read from the store now and then, not with every query."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass

from firstfix.catalog.geopose import MEDIA_TYPE, Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.errors import NotAcceptable, StoreUnavailable

MAX_MAPS = 1024


@dataclass(frozen=True)
class _Known:
    georeference: Georeference | None
    until: float  # time.monotonic


class GeoreferenceCache:
    """Thread-safe. What was known stays so while the store does not answer."""

    def __init__(self, georeferences: Georeferences, ttl_s: float) -> None:
        self._georeferences = georeferences
        self._ttl_s = ttl_s
        self._known: OrderedDict[str, _Known] = OrderedDict()
        self._lock = threading.Lock()

    def of(self, map_id: str) -> Georeference:
        """
        Raises:
            NotAcceptable: the map has none, so its poses have no geographic form.
            InvalidOption: the id is none.
            StoreError: the store failed, and nothing is known from before.
        """
        with self._lock:
            known = self._known.get(map_id)
        if known is None or time.monotonic() > known.until:
            try:
                georeference = self._georeferences.get(map_id)
            except StoreUnavailable:
                if known is None:
                    raise
                georeference = known.georeference
            known = _Known(georeference, time.monotonic() + self._ttl_s)
            with self._lock:
                self._known[map_id] = known
                self._known.move_to_end(map_id)
                while len(self._known) > MAX_MAPS:
                    self._known.popitem(last=False)
        if known.georeference is None:
            raise NotAcceptable(f"map {map_id} has no georeference, so no pose in it is {MEDIA_TYPE}")
        return known.georeference

    def forget(self, map_id: str) -> None:
        """It was changed here."""
        with self._lock:
            self._known.pop(map_id, None)
