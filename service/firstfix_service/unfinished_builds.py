"""The builds on record that have not ended: what every queue comes back to."""

from __future__ import annotations

from firstfix.build_records import FINAL_STATES
from firstfix.catalog import Catalog
from firstfix.errors import NotFound, UnreadableRecord

from .metrics import Metrics


class UnfinishedBuilds:
    """Remembers which have ended, as that does not change. One thread's at a time."""

    def __init__(self, catalog: Catalog, metrics: Metrics) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._ended: set[str] = set()

    def find(self) -> list[str]:
        """Oldest first: their ids begin with the time."""
        found = []
        on_record = self._catalog.build_ids()
        self._ended.intersection_update(on_record)
        for build_id in on_record:
            if build_id in self._ended:
                continue
            try:
                state = self._catalog.build_status(build_id)["state"]
            except (NotFound, UnreadableRecord):  # no request: no build; damaged: all others go on
                continue
            if state in FINAL_STATES:
                self._ended.add(build_id)
            else:
                found.append(build_id)
        self._metrics.builds_waiting.set(len(found))
        return found
