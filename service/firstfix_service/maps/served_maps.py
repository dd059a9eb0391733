"""Which maps there are, and which version of each answers."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Set

from ..telemetry.metrics import Metrics


class ServedMaps:
    """Thread-safe. What is said is as of the last poll, or a query since."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._lock = threading.Lock()
        self._published: set[str] = set()  # maps with a version
        self._serving: dict[str, str] = {}  # map id -> version that answers when none is named
        self._behind: set[str] = set()  # maps whose active version was refused
        self._touched: set[str] = set()

    def __len__(self) -> int:
        with self._lock:
            return len(self._published)

    def __contains__(self, map_id: object) -> bool:
        """Whether a map has a version."""
        with self._lock:
            return map_id in self._published

    @property
    def ids(self) -> list[str]:
        """Maps with a version, in order."""
        with self._lock:
            return sorted(self._published)

    @property
    def versions(self) -> dict[str, str]:
        """Map id to the version that answers when none is named, of maps asked for or loaded so far."""
        with self._lock:
            return dict(self._serving)

    def version(self, map_id: str) -> str | None:
        """That of one map."""
        with self._lock:
            return self._serving.get(map_id)

    def is_behind(self, map_id: str) -> bool:
        """Whether another version answers than the active one, which was refused."""
        with self._lock:
            return map_id in self._behind

    def add(self, map_ids: Set[str]) -> None:
        """These have a version."""
        with self._lock:
            self._published |= map_ids
            self._touched |= map_ids

    def serve(self, map_id: str, version: str, *, is_active: bool) -> str | None:
        """This version answers from now on; returns the one that did."""
        with self._lock:
            before = self._serving.get(map_id)
            self._serving[map_id] = version
            self._published.add(map_id)
            self._touched.add(map_id)
            (self._behind.discard if is_active else self._behind.add)(map_id)
            self._metrics.maps_behind.set(len(self._behind))
        return before

    def forget(self, map_id: str) -> None:
        """It has nothing active any more."""
        with self._lock:
            self._published.discard(map_id)
            self._serving.pop(map_id, None)
            self._behind.discard(map_id)
            self._touched.add(map_id)
            self._metrics.maps_behind.set(len(self._behind))

    def touch(self, map_ids: Iterable[str]) -> None:
        """Something that callers look at may have changed of these."""
        with self._lock:
            self._touched.update(map_ids)

    def take_touched(self) -> set[str]:
        """Maps of which what is said here, or of their logs, may have changed since the last call."""
        with self._lock:
            touched, self._touched = self._touched, set()
            return touched
