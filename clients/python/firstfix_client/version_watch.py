"""Notices over zenoh about changes of the maps' active versions."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from firstfix.ids import is_name

VERSIONS = "firstfix/*/version"
LOOK_S = 5.0  # timeout of one look
MAX_NOTICE_BYTES = 4096
MAX_MAPS = 100_000
MAX_SEQ = 1 << 53
MAX_VERSION_CHARS = 64


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

    Notices are not signed: where zenoh has no access rules, anybody may send one. A false one is reported
    until the replicas have contradicted it twice when asked.

    Iterate in one thread. ``close`` may be called from another thread and ends the iteration.
    """

    def __init__(self, session: Any, look_every_s: float) -> None:
        self._session = session
        self._look_every_s = look_every_s
        self._reported: dict[str, str | None] = {}
        self._seen: dict[str, tuple[int, str | None]] = {}  # map id -> newest seq, and its active version
        self._contradicted: dict[str, int] = {}  # map id -> seq that the last look found too high
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
        """End the iteration."""
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
        newest: dict[str, _Told] = {}
        for reply in self._session.get(VERSIONS, timeout=LOOK_S):
            told = None if reply.ok is None else _read(reply.ok.payload)
            if told is not None and told.seq >= newest.get(told.map_id, told).seq:
                newest[told.map_id] = told
        with self._condition:
            for told in newest.values():
                self._take(told, is_certain=self._contradicts_again(told))

    def _on_notice(self, sample: Any) -> None:
        told = _read(sample.payload)
        if told is not None:
            with self._condition:
                self._take(told)

    def _contradicts_again(self, told: _Told) -> bool:
        """Whether the replicas know no such high number, as at the look before.

        Once is not enough: those that answered may not have followed a change yet.
        """
        seen = self._seen.get(told.map_id, (told.seq, None))[0]
        before = self._contradicted.pop(told.map_id, None)
        if told.seq < seen and before != seen:
            self._contradicted[told.map_id] = seen
        return told.seq < seen and before == seen

    def _take(self, told: _Told, *, is_certain: bool = False) -> None:
        seen = self._seen.get(told.map_id)
        if seen is None and len(self._seen) >= MAX_MAPS:
            return
        if seen is not None and told.seq <= seen[0] and not is_certain:
            return
        self._seen[told.map_id] = told.seq, told.version
        self._changed[told.map_id] = None
        self._condition.notify_all()


@dataclass(frozen=True)
class _Told:
    map_id: str
    seq: int
    version: str | None


def _read(payload: Any) -> _Told | None:
    """Read a notice. Returns None for anything else, from a stranger or a later release."""
    if len(payload) > MAX_NOTICE_BYTES:
        return None
    try:
        value = json.loads(payload.to_bytes())
        map_id, seq, version = value["map_id"], value["seq"], value["version"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    if not isinstance(map_id, str) or not is_name(map_id):
        return None
    if type(seq) is not int or not 0 <= seq < MAX_SEQ:
        return None
    if version is not None and not (isinstance(version, str) and len(version) <= MAX_VERSION_CHARS):
        return None
    return _Told(map_id, seq, version)
