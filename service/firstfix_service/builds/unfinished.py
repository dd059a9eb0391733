"""The builds on record that have not ended: what every queue comes back to."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.builds.records import FINAL_STATES
from firstfix.catalog.catalog import Catalog
from firstfix.errors import NotFound, UnreadableRecord

from ..telemetry.metrics import Metrics


@dataclass(frozen=True)
class Unfinished:
    """A build that waits or runs.

    Attributes:
        owner: who handed it in; empty where the record does not say.
    """

    build_id: str
    owner: str


class UnfinishedBuilds:
    """Remembers which have ended, and whose the others are: neither changes. One thread's at a time."""

    def __init__(self, catalog: Catalog, metrics: Metrics) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._ended: set[str] = set()
        self._known: dict[str, Unfinished] = {}

    def find(self) -> list[Unfinished]:
        """Oldest first: their ids begin with the time."""
        found = []
        on_record = self._catalog.build_ids()
        self._ended.intersection_update(on_record)
        for build_id in on_record:
            if build_id in self._ended:
                continue
            try:
                state = self._catalog.build_status(build_id)["state"]
                if state in FINAL_STATES:
                    self._ended.add(build_id)
                    continue
                found.append(self._known.get(build_id) or self._read(build_id))
            except (NotFound, UnreadableRecord):  # no request: no build; damaged: all others go on
                continue
        self._known = {build.build_id: build for build in found}
        self._metrics.builds_waiting.set(len(found))
        return found

    def _read(self, build_id: str) -> Unfinished:
        return Unfinished(build_id, str(self._catalog.build_request(build_id).get("owner") or ""))
