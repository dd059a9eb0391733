"""The builds on record that have not ended. Every queue looks for them again and again."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.builds.records import FINAL_STATES
from firstfix.catalog.catalog import Catalog
from firstfix.errors import NotFound, UnreadableRecord

from ..telemetry.metrics import Metrics


@dataclass(frozen=True)
class UnfinishedBuild:
    """A build that waits or runs.

    Attributes:
        owner: the caller who submitted it; empty if the record does not say.
    """

    build_id: str
    owner: str


class UnfinishedBuilds:
    """Finds unfinished builds. Not thread-safe.

    It remembers which builds have ended and who owns the others, because neither ever changes.
    """

    def __init__(self, catalog: Catalog, metrics: Metrics) -> None:
        self._catalog = catalog
        self._metrics = metrics
        self._ended: set[str] = set()
        self._known: dict[str, UnfinishedBuild] = {}

    def find(self) -> list[UnfinishedBuild]:
        """Returns the unfinished builds, oldest first: build ids begin with the time."""
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
            except (
                NotFound,
                UnreadableRecord,
            ):  # without a request there is no build; a damaged one is skipped
                continue
        self._known = {build.build_id: build for build in found}
        self._metrics.builds_waiting.set(len(found))
        return found

    def _read(self, build_id: str) -> UnfinishedBuild:
        return UnfinishedBuild(build_id, str(self._catalog.build_request(build_id).get("owner") or ""))
