"""Notices over zenoh about changes of the maps' active versions."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any

VERSIONS = "firstfix/*/version"
LOOK_S = 5.0  # timeout of one look


@dataclass(frozen=True)
class VersionChange:
    """Change of a map's active version.

    Attributes:
        version: digest of the version that is active now; None: the map has none any more.
        previous: version that this watch reported before; None the first time.
    """

    map_id: str
    version: str | None
    previous: str | None


class VersionWatch:
    """Iterator over changes of active versions: first one change for every map, then each new one.

    Changes of one map come in the order in which they were made. Each comes once, even if several replicas
    report it. A version that was active only for a moment may be left out; the newest one always comes. It
    comes when the first replica has switched; others may answer with the old version for one more poll
    interval. Notices can get lost, so the watch also asks for the versions at intervals.

    Iterate in one thread. ``close`` may be called from another thread and ends the iteration.
    """

    def __init__(self, session: Any, look_every_s: float) -> None:
        self._session = session
        self._look_every_s = look_every_s
        self._reported: dict[str, str | None] = {}
        self._seen: dict[str, tuple[int, str | None]] = {}  # map id -> newest seq, and its active version
        self._changed: dict[str, None] = {}  # maps to report, in order: at most one entry a map
        self._condition = threading.Condition()
        self._closed = False
        self._subscriber = session.declare_subscriber(VERSIONS, self._on_notice)
        self._next_look = 0.0

    def __enter__(self) -> VersionWatch:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the iteration."""
        with self._condition:
            if self._closed:
                return
            self._closed = True
            self._condition.notify_all()
        self._subscriber.undeclare()

    def __iter__(self) -> Iterator[VersionChange]:
        return self

    def __next__(self) -> VersionChange:
        while True:
            with self._condition:
                while self._changed:
                    map_id = next(iter(self._changed))
                    del self._changed[map_id]
                    version, previous = self._seen[map_id][1], self._reported.get(map_id)
                    if version != previous:
                        self._reported[map_id] = version
                        return VersionChange(map_id, version, previous)
                if self._closed:
                    raise StopIteration
                left_s = self._next_look - time.monotonic()
                if left_s > 0:
                    self._condition.wait(left_s)
                    continue
            self._look()

    def _look(self) -> None:
        self._next_look = time.monotonic() + self._look_every_s
        for reply in self._session.get(VERSIONS, timeout=LOOK_S):
            if reply.ok is not None:
                self._take(reply.ok.payload.to_bytes())

    def _on_notice(self, sample: Any) -> None:
        self._take(sample.payload.to_bytes())

    def _take(self, document: bytes) -> None:
        try:
            value = json.loads(document)
            map_id, seq, version = str(value["map_id"]), int(value["seq"]), value["version"]
        except (ValueError, KeyError, TypeError):  # from a replica that this client does not understand
            return
        with self._condition:
            if map_id in self._seen and seq <= self._seen[map_id][0]:
                return
            self._seen[map_id] = seq, version
            self._changed[map_id] = None
            self._condition.notify_all()
