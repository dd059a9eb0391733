"""The log of a map: what was published, activated, retired and collected, and by that what is served.

Entries are numbered objects that are only ever created, never replaced. Two writers that want the
same number race in one create-only put; the loser reads the winner's entry, checks its own
precondition against it, and takes the next number. So an entry always holds for exactly the state
before it, on every store and without a lock.

The files of a version stand in a folder of a generation, which ``retired`` or ``collected`` ends: from then
on a remover may take the files whenever it gets to it, and a publish that began before is not recorded any
more. Whoever publishes the version again puts its files into the next generation, which no remover knows.
"""

from __future__ import annotations

import json
import logging
import random
import re
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from enum import Enum
from typing import Any

from .errors import FirstfixError, StoreUnavailable
from .ids import check_version
from .store import Store

_log = logging.getLogger(__name__)
_ENTRY_NAME = re.compile(r"(\d{6,})\.json")
_MAX_RACES = 200


class Event(str, Enum):
    PUBLISHED = "published"
    ACTIVATED = "activated"
    RETIRED = "retired"
    COLLECTED = "collected"  # files of a publish that never ended; readers that do not know it skip it


@dataclass(frozen=True)
class LogEntry:
    """One event.

    Attributes:
        seq: 1, 2, ...
        time: of writing, UTC, ISO 8601; for people: the order is seq's.
        build_id: of the build that caused it; empty when a person did.
        writer: unique to one append, so that a writer whose reply was lost knows its own entry.
        generation: of ``published``: of the folder with the files.
    """

    seq: int
    event: Event
    version: str
    time: str
    build_id: str = ""
    writer: str = ""
    generation: int = 0

    def to_json(self) -> bytes:
        values = {**asdict(self), "event": self.event.value}
        del values["seq"]  # it is the object's name
        return json.dumps(values, sort_keys=True).encode("ascii")

    @classmethod
    def from_json(cls, seq: int, data: bytes) -> LogEntry:
        """
        Raises:
            ValueError: not an entry, or an event that this reader does not know.
        """
        try:
            values: dict[str, Any] = json.loads(data)
            if datetime.fromisoformat(values["time"]).tzinfo is None:
                raise ValueError("its time has no zone")
            return cls(
                seq,
                Event(values["event"]),
                check_version(values["version"]),
                values["time"],
                str(values.get("build_id", "")),
                str(values.get("writer", "")),
                int(values.get("generation", 0)),
            )
        except (KeyError, TypeError, AttributeError, FirstfixError) as error:
            raise ValueError(f"not a log entry: {error}") from None


@dataclass(frozen=True)
class MapState:
    """What a log adds up to.

    Attributes:
        entries: in order.
        published: versions that can be served, in the order they were first published.
        activated: those of them that were ever active, the latest activation first: the active one,
            then what to fall back to.
        last_seq: of the last entry, readable or not; 0 for an empty log.
        generations: of the published versions: which folder their files stand in.
        ended: version to the ``seq`` of the entry that ended its last generation.
    """

    entries: tuple[LogEntry, ...] = ()
    published: tuple[str, ...] = ()
    activated: tuple[str, ...] = ()
    last_seq: int = 0
    generations: Mapping[str, int] = field(default_factory=dict)
    ended: Mapping[str, int] = field(default_factory=dict)

    @property
    def exists(self) -> bool:
        """Whether the map ever had a version to serve."""
        return any(entry.event is Event.PUBLISHED for entry in self.entries)

    def generation(self, version: str) -> int:
        """Of the folder that the version's files stand in, or are put into to publish it: 0, or the ``seq``
        of the entry that ended the generation before it."""
        return self.generations.get(version, self.ended.get(version, 0))

    @property
    def active(self) -> str | None:
        return self.activated[0] if self.activated else None

    @classmethod
    def of(cls, entries: tuple[LogEntry, ...], last_seq: int) -> MapState:
        published: list[str] = []
        activated: list[str] = []
        generations: dict[str, int] = {}
        ended: dict[str, int] = {}
        for entry in entries:
            version = entry.version
            if entry.event is Event.PUBLISHED:
                if version not in published:
                    published.append(version)
                    generations[version] = entry.generation
            elif entry.event is Event.ACTIVATED:
                if version in published:
                    activated = [version, *(v for v in activated if v != version)]
            else:
                ended[version] = entry.seq
            if entry.event is Event.RETIRED:
                published = [v for v in published if v != version]
                activated = [v for v in activated if v != version]
                generations.pop(version, None)
        return cls(entries, tuple(published), tuple(activated), last_seq, generations, ended)


class MapLog:
    """The log at one folder of a store. Thread-safe; remembers what it read, as entries never change."""

    def __init__(self, store: Store, folder: str) -> None:
        self._store = store
        self._folder = folder
        self._entries: dict[int, LogEntry | None] = {}  # None: unreadable, skipped
        self._lock = threading.Lock()

    def state(self) -> MapState:
        """What the log adds up to now.

        An entry that cannot be read, or of an event of a later firstfix, is skipped with a warning:
        the others still say what to serve.
        """
        names = [key.rsplit("/", 1)[-1] for key in self._store.list(self._folder)]
        found = sorted(int(match[1]) for name in names if (match := _ENTRY_NAME.fullmatch(name)))
        for seq in found:
            if seq not in self._entries:
                self._read(seq)
        with self._lock:
            entries = tuple(entry for seq in found if (entry := self._entries[seq]) is not None)
        return MapState.of(entries, found[-1] if found else 0)

    def known_state(self) -> MapState:
        """What it added up to when it was last read: the store is not asked."""
        with self._lock:
            read = sorted(self._entries)
            entries = tuple(entry for seq in read if (entry := self._entries[seq]) is not None)
        return MapState.of(entries, read[-1] if read else 0)

    def changed_since(self, time: datetime) -> set[str]:
        """The versions of the entries that were written after that time, by the store's clock: those in the
        entries are their writers'."""
        changed = set()
        for item in self._store.scan(self._folder):
            match = _ENTRY_NAME.fullmatch(item.key.rsplit("/", 1)[-1])
            if match and item.last_modified > time and (entry := self._entry(int(match[1]))) is not None:
                changed.add(entry.version)
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
            state = self.state()
            if not needed(state):
                return None
            seq = state.last_seq + 1
            now = datetime.now(timezone.utc).isoformat(timespec="seconds")
            entry = LogEntry(seq, event, check_version(version), now, build_id, writer, generation)
            if self._store.put_new(self._key(seq), entry.to_json()):
                with self._lock:
                    self._entries[seq] = entry
                return entry
            # Lost the race, or won it and lost the reply: then the entry there is this writer's.
            there = self._read(seq)
            if there is not None and there.writer == writer:
                return there
            time.sleep(random.uniform(0, 0.01 * min(race + 1, 20)))
        raise StoreUnavailable(f"{self._folder}: {_MAX_RACES} races lost in a row")

    def _entry(self, seq: int) -> LogEntry | None:
        with self._lock:
            if seq in self._entries:
                return self._entries[seq]
        return self._read(seq)

    def _read(self, seq: int) -> LogEntry | None:
        try:
            entry: LogEntry | None = LogEntry.from_json(seq, self._store.get(self._key(seq)))
        except ValueError as error:
            _log.warning("skipping %s: %s", self._key(seq), error)
            entry = None
        with self._lock:
            self._entries[seq] = entry
        return entry

    def _key(self, seq: int) -> str:
        return f"{self._folder}/{seq:06d}.json"
