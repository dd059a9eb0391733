"""Log of a map: publications, activations, retirements and collections, which determine what is served.

    <map>/log/000001.json, ...         entries
    <map>/snapshots/000050.json, ...   sum of all entries up to this number

Entries are numbered objects that are only ever created, never replaced. Two writers that want the same number
race in one create-only put. The loser reads the winner's entry, checks its own precondition against it, and
takes the next number. So the precondition of an entry is true for exactly the state before it, on every store
and without a lock.

The files of a version are in a folder of a generation. An entry ``retired`` or ``collected`` ends the
generation: from then on its files may be removed at any time, and a publication that began before is no
longer recorded. A process that publishes the version again puts its files into the next generation, which no
collection knows.

Every ``ENTRIES_PER_SNAPSHOT`` entries a writer puts a snapshot. A reader begins with the newest readable
snapshot and reads only the entries after it, so its calls are bounded, however long the log is.
``log_garbage`` removes entries long after they are in snapshots. A writer that was stopped for so long
between its read and its put could create a removed number again. So after its put it looks at the snapshots:
if a snapshot of the same or a higher number does not contain its entry, the entry is not part of the log. The
writer removes it and begins again.
"""

from __future__ import annotations

import logging
import random
import threading
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import islice
from typing import Any

from ...errors import NotFound, StoreError, StoreUnavailable, TooLarge, UnreadableRecord
from ...ids import check_version
from ...store.flipped_bit import with_bit_restored
from ...store.json_record import RecordKind, max_bytes, parse_record, read_each, read_record
from ...store.numbered import scan_after
from ...store.store import Store
from .map_state import MAX_SKIPPED, Event, LogEntry, MapState

_log = logging.getLogger(__name__)
ENTRIES_PER_SNAPSHOT = 50
_MAX_RACES = 200
_MAX_LOOKS = 5  # of one reader, while entries that it is about to read are collected
NOT_TOLD: Mapping[str, Any] = {}


@dataclass(frozen=True)
class _Seen:
    """Copy of a log in memory.

    Attributes:
        base: state from which the next read begins.
        entries: entries after it by number; None for a damaged one.
        state: sum of both.
        has_foreign: there is an entry of a later release, so this release must not put a snapshot.
    """

    base: MapState
    entries: dict[int, LogEntry | None]
    state: MapState
    has_foreign: bool = False

    @classmethod
    def of(cls, base: MapState, entries: dict[int, LogEntry | None], has_foreign: bool) -> _Seen:
        """Make a copy. Moves the base forward after many entries, so that a long-lived reader lists few."""
        if len(entries) > 2 * ENTRIES_PER_SNAPSHOT:
            listed = list(entries.items())
            base, entries = (
                _sum_up(base, dict(listed[:-ENTRIES_PER_SNAPSHOT])),
                dict(listed[-ENTRIES_PER_SNAPSHOT:]),
            )
        return cls(base, entries, _sum_up(base, entries), has_foreign)


class MapLog:
    """Log in one folder of a store. Thread-safe. Remembers what it read, because entries never change."""

    def __init__(self, store: Store, folder: str) -> None:
        self._store = store
        self._folder = folder
        self._snapshots = snapshots_of(folder)
        self._seen: _Seen | None = None
        self._lock = threading.Lock()

    def state(self) -> MapState:
        """Current state of the map.

        An entry in which one bit has flipped counts as it was. Another damaged entry, or one of a later
        release, is skipped with a warning: the others still tell what to serve.
        """
        return self._look().state

    def known_state(self) -> MapState:
        """State of the map when it was last read. Sends no request to the store."""
        with self._lock:
            return MapState() if self._seen is None else self._seen.state

    def changed_since(self, time: datetime) -> set[str]:
        """Versions in the entries that were written after a time by the store's clock.

        The times in the entries are from the clocks of their writers.
        """
        changed = set()
        for seq, item in scan_after(self._store, self._folder, 0).items():
            if item.last_modified > time:
                with suppress(NotFound):
                    entry, _ = self._read(seq)
                    changed |= set() if entry is None else {entry.version}
        return changed

    def append(
        self,
        event: Event,
        version: str,
        *,
        build_id: str = "",
        generation: int = 0,
        provisional: bool = False,
        provenance: Mapping[str, Any] = NOT_TOLD,
        summary: Mapping[str, Any] = NOT_TOLD,
        needed: Callable[[MapState], bool],
    ) -> LogEntry | None:
        """Append an entry if it is needed in the state before it.

        Args:
            needed: takes the state before the entry. Returns False if nothing has to be written. Raises to
                refuse the entry.

        Returns:
            The entry, or None if it was not needed.
        """
        writer = uuid.uuid4().hex
        for race in range(_MAX_RACES):
            seen = self._look()
            if not needed(seen.state):
                return None
            seq = seen.state.last_seq + 1
            now = datetime.now(timezone.utc).isoformat(timespec="seconds")
            known = (check_version(version), now, build_id, writer, generation, provisional)
            entry = LogEntry(seq, event, *known, provenance, summary)
            if self._create(entry):
                newer = scan_after(self._store, self._snapshots, max(0, seq - ENTRIES_PER_SNAPSHOT))
                if self._is_part(entry, list(newer)):
                    new = _Seen.of(seen.base, {**seen.entries, seq: entry}, seen.has_foreign)
                    self._keep(new)
                    if seq >= ENTRIES_PER_SNAPSHOT and not newer:
                        self._put_snapshot(new)
                    return entry
                self._store.delete(self._key(seq))
                self._forget()
            time.sleep(random.uniform(0, 0.01 * min(race + 1, 20)))
        raise StoreUnavailable(f"{self._folder}: {_MAX_RACES} races lost in a row")

    def put_missing_snapshot(self) -> None:
        """Put a snapshot if there are many entries after the newest one, because a writer was killed."""
        seen = self._look()
        last = seen.state.last_seq
        if last - max(scan_after(self._store, self._snapshots, 0), default=0) >= ENTRIES_PER_SNAPSHOT:
            self._put_snapshot(seen)

    def _create(self, entry: LogEntry) -> bool:
        """Put an entry. Returns False if another writer has its number."""
        if self._store.put_new(self._key(entry.seq), entry.to_json()):
            return True
        try:  # it is ours if the reply to our put was lost
            there, _ = self._read(entry.seq)
        except NotFound:  # collected: this writer was stopped for long
            return False
        return there is not None and there.writer == entry.writer

    def _is_part(self, entry: LogEntry, snapshots: Sequence[int]) -> bool:
        """Whether the entry is part of the log.

        It is if no snapshot has its number or a higher one, or if the next readable one contains it.
        """
        for number in snapshots:
            if number >= entry.seq and (state := self._read_snapshot(number)) is not None:
                return any((e.seq, e.writer) == (entry.seq, entry.writer) for e in state.entries)
        return True

    def _look(self) -> _Seen:
        with self._lock:
            seen = self._seen
        base = self._newest_snapshot() if seen is None else seen.base
        known = {} if seen is None else seen.entries
        for _ in range(_MAX_LOOKS):
            found = list(scan_after(self._store, self._folder, base.last_seq))
            if found and len(found) < found[-1] - base.last_seq:  # some are missing: they are in a snapshot
                newer = self._newest_snapshot(base.last_seq)
                if newer.last_seq > base.last_seq:
                    base, known = newer, {}
                    continue
            try:
                return self._remember(seen, base, known, found)
            except NotFound:  # they have just been collected
                base, known = self._newest_snapshot(), {}
        raise StoreUnavailable(f"{self._folder}: its entries were collected while they were read")

    def _remember(
        self, seen: _Seen | None, base: MapState, known: dict[int, LogEntry | None], found: list[int]
    ) -> _Seen:
        unread = [seq for seq in found if known.get(seq) is None]
        if seen is not None and base is seen.base and not unread and found == list(seen.entries):
            return seen
        read = read_each(unread, self._read)
        entries = {seq: known.get(seq) or read[seq][0] for seq in found}
        new = _Seen.of(base, entries, any(is_foreign for _, is_foreign in read.values()))
        self._keep(new)
        return new

    def _keep(self, new: _Seen) -> None:
        with self._lock:
            if self._seen is None or self._seen.state.last_seq <= new.state.last_seq:
                self._seen = new

    def _forget(self) -> None:
        with self._lock:
            self._seen = None

    def _read(self, seq: int) -> tuple[LogEntry | None, bool]:
        """Read an entry. Returns None if it cannot be used, and whether it is of a later release.

        Raises:
            NotFound: no such entry.
        """

        def parse(record: dict[str, Any]) -> LogEntry | None:
            return LogEntry.parse(seq, record)

        try:
            entry = read_record(self._store, self._key(seq), RecordKind.LOG_ENTRY, parse)
        except UnreadableRecord:
            return self._restored(seq, parse), False
        if entry is None:
            _log.warning("skipping %s: an event of a later release", self._key(seq))
        return entry, entry is None

    def _restored(self, seq: int, parse: Callable[[dict[str, Any]], LogEntry | None]) -> LogEntry | None:
        """A damaged entry, if just one bit of it has flipped.

        Raises:
            NotFound: it was removed meanwhile.
        """
        with suppress(TooLarge, ValueError):
            data = self._store.get(self._key(seq), max_bytes=max_bytes(RecordKind.LOG_ENTRY))
            restored = with_bit_restored(data, RecordKind.LOG_ENTRY)
            if restored is not None:
                return parse_record(restored, RecordKind.LOG_ENTRY, parse)
        return None

    def _newest_snapshot(self, after: int = 0) -> MapState:
        """Newest readable snapshot, or the state of an empty log."""
        for number in reversed(scan_after(self._store, self._snapshots, after)):
            if (state := self._read_snapshot(number)) is not None:
                return state
        return MapState()

    def _read_snapshot(self, number: int) -> MapState | None:
        return read_snapshot(self._store, self._snapshots, number)

    def _put_snapshot(self, seen: _Seen) -> None:
        """Put a snapshot. It only saves calls: if it fails, the next writer puts one."""
        if seen.has_foreign:
            return
        state = seen.state
        try:
            self._store.put_new(f"{self._snapshots}/{state.last_seq:06d}.json", state.to_json())
        except StoreError as error:
            _log.warning("no snapshot of %s: %s", self._folder, error)

    def _key(self, seq: int) -> str:
        return f"{self._folder}/{seq:06d}.json"


def snapshots_of(folder: str) -> str:
    """Folder of the snapshots of a log."""
    return "/".join((*folder.split("/")[:-1], "snapshots"))


def read_snapshot(store: Store, folder: str, number: int) -> MapState | None:
    """Read a snapshot by its number. Returns None if it is damaged or was collected."""

    def parse(record: dict[str, Any]) -> MapState:
        return MapState.parse(number, record)

    try:
        return read_record(store, f"{folder}/{number:06d}.json", RecordKind.LOG_SNAPSHOT, parse)
    except (NotFound, UnreadableRecord):
        return None


def _sum_up(base: MapState, entries: dict[int, LogEntry | None]) -> MapState:
    if not entries:
        return base
    last = max(entries)
    numbers = range(base.last_seq + 1, last + 1)
    skipped = islice((seq for seq in numbers if entries.get(seq) is None), MAX_SKIPPED)
    return base.after([entry for entry in entries.values() if entry is not None], last, skipped)
