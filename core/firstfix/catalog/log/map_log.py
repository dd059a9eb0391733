"""The log of a map: what was published, activated, retired and collected, and by that what is served.

    <map>/log/000001.json, ...         entries
    <map>/snapshots/000050.json, ...   what all entries up to that number add up to

Entries are numbered objects that are only ever created, never replaced. Two writers that want the
same number race in one create-only put; the loser reads the winner's entry, checks its own
precondition against it, and takes the next number. So an entry always holds for exactly the state
before it, on every store and without a lock.

The files of a version stand in a folder of a generation, which ``retired`` or ``collected`` ends: from then
on a remover may take the files whenever it gets to it, and a publish that began before is not recorded any
more. Whoever publishes the version again puts its files into the next generation, which no remover knows.

Every ``ENTRIES_PER_SNAPSHOT`` entries a writer leaves a snapshot. A reader begins with the newest one that it can read and
asks for the entries after it alone: its calls are bounded, however long the log is. ``log_garbage``
removes entries long after they are in snapshots. A writer that was stopped for so long between its look and
its put could create a removed number again: so it looks at the snapshots after its put, and an entry that a
snapshot of the same or a higher number does not know was not part of the log: it is taken back, and the
writer begins again.
"""

from __future__ import annotations

import logging
import random
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import islice
from typing import Any

from ...errors import NotFound, StoreError, StoreUnavailable, UnreadableRecord
from ...ids import check_version
from ...store.json_record import RecordKind, read_each, read_record
from ...store.numbered import scan_after
from ...store.store import Store
from .map_state import MAX_SKIPPED, Event, LogEntry, MapState

_log = logging.getLogger(__name__)
ENTRIES_PER_SNAPSHOT = 50
_MAX_RACES = 200
_MAX_LOOKS = 5  # of one reader, while what it was about to read is collected


@dataclass(frozen=True)
class _Seen:
    """One reader's copy of a log.

    Attributes:
        base: a state, by which to begin the next look.
        entries: those after it by their numbers; None: it cannot be read.
        state: what both add up to.
        has_foreign: an entry is of a later firstfix: this one is not to sum it up for others.
    """

    base: MapState
    entries: dict[int, LogEntry | None]
    state: MapState
    has_foreign: bool = False

    @classmethod
    def of(cls, base: MapState, entries: dict[int, LogEntry | None], has_foreign: bool) -> _Seen:
        """With a later base, once many entries follow: so that a reader that lives long lists few."""
        if len(entries) > 2 * ENTRIES_PER_SNAPSHOT:
            listed = list(entries.items())
            base, entries = (
                _added_up(base, dict(listed[:-ENTRIES_PER_SNAPSHOT])),
                dict(listed[-ENTRIES_PER_SNAPSHOT:]),
            )
        return cls(base, entries, _added_up(base, entries), has_foreign)


class MapLog:
    """The log at one folder of a store. Thread-safe; remembers what it read, as entries never change."""

    def __init__(self, store: Store, folder: str) -> None:
        self._store = store
        self._folder = folder
        self._snapshots = snapshots_of(folder)
        self._seen: _Seen | None = None
        self._lock = threading.Lock()

    def state(self) -> MapState:
        """What the log adds up to now.

        An entry that cannot be read, or of an event of a later firstfix, is skipped with a warning:
        the others still say what to serve.
        """
        return self._look().state

    def known_state(self) -> MapState:
        """What it added up to when it was last read: the store is not asked."""
        with self._lock:
            return MapState() if self._seen is None else self._seen.state

    def changed_since(self, time: datetime) -> set[str]:
        """The versions of the entries that were written after that time, by the store's clock: those in the
        entries are their writers'."""
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
        needed: Callable[[MapState], bool],
    ) -> LogEntry | None:
        """Adds an entry, if it is still needed in the state that it follows.

        Args:
            needed: False: somebody did it already, nothing is written; it raises to refuse.

        Returns:
            the entry, or None when it was not needed.
        """
        writer = uuid.uuid4().hex
        for race in range(_MAX_RACES):
            seen = self._look()
            if not needed(seen.state):
                return None
            seq = seen.state.last_seq + 1
            now = datetime.now(timezone.utc).isoformat(timespec="seconds")
            entry = LogEntry(seq, event, check_version(version), now, build_id, writer, generation)
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

    def leave_snapshot(self) -> None:
        """Puts a snapshot, where there are many entries after the newest one: of a log that was written by
        a release that left none, or whose writer was killed."""
        seen = self._look()
        last = seen.state.last_seq
        if last - max(scan_after(self._store, self._snapshots, 0), default=0) >= ENTRIES_PER_SNAPSHOT:
            self._put_snapshot(seen)

    def _create(self, entry: LogEntry) -> bool:
        """False: lost the race. One that was won, with the reply lost, left this writer's entry there."""
        if self._store.put_new(self._key(entry.seq), entry.to_json()):
            return True
        try:
            there, _ = self._read(entry.seq)
        except NotFound:  # collected: this writer is far behind
            return False
        return there is not None and there.writer == entry.writer

    def _is_part(self, entry: LogEntry, snapshots: Sequence[int]) -> bool:
        """Whether readers take the entry: no snapshot has its number or a higher one, or the next one that
        can be read knows it."""
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
            if found and len(found) < found[-1] - base.last_seq:  # some are missing: a snapshot has them
                newer = self._newest_snapshot(base.last_seq)
                if newer.last_seq > base.last_seq:
                    base, known = newer, {}
                    continue
            try:
                return self._remember(seen, base, known, found)
            except NotFound:  # collected just now
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
        """The entry, None where it cannot be used; and whether it is of a later firstfix.

        Raises:
            NotFound: it is not there.
        """

        def parse(record: dict[str, Any]) -> LogEntry | None:
            return LogEntry.parse(seq, record)

        try:
            entry = read_record(self._store, self._key(seq), RecordKind.LOG_ENTRY, parse)
        except UnreadableRecord:
            return None, False
        if entry is None:
            _log.warning("skipping %s: an event of a later firstfix", self._key(seq))
        return entry, entry is None

    def _newest_snapshot(self, after: int = 0) -> MapState:
        """The newest one that can be read; where there is none the state of an empty log."""
        for number in reversed(scan_after(self._store, self._snapshots, after)):
            if (state := self._read_snapshot(number)) is not None:
                return state
        return MapState()

    def _read_snapshot(self, number: int) -> MapState | None:
        return read_snapshot(self._store, self._snapshots, number)

    def _put_snapshot(self, seen: _Seen) -> None:
        """A reader's help and no more: where it cannot be put the next writer puts one."""
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
    """The folder of the snapshots, beside that of the log."""
    return "/".join((*folder.split("/")[:-1], "snapshots"))


def read_snapshot(store: Store, folder: str, number: int) -> MapState | None:
    """A snapshot by its number; None: it cannot be read, or was collected."""

    def parse(record: dict[str, Any]) -> MapState:
        return MapState.parse(number, record)

    try:
        return read_record(store, f"{folder}/{number:06d}.json", RecordKind.LOG_SNAPSHOT, parse)
    except (NotFound, UnreadableRecord):
        return None


def _added_up(base: MapState, entries: dict[int, LogEntry | None]) -> MapState:
    if not entries:
        return base
    last = max(entries)
    numbers = range(base.last_seq + 1, last + 1)
    skipped = islice((seq for seq in numbers if entries.get(seq) is None), MAX_SKIPPED)
    return base.after([entry for entry in entries.values() if entry is not None], last, skipped)
