"""State of a map: the sum of its log's entries, without keeping every entry."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from enum import Enum
from typing import Any

from ...ids import check_version
from ...store.json_record import record_json, text_of, whole_number_of

HISTORY = 200  # newest entries that a state keeps
MARKS = 1000  # entries that a state keeps because they are the last of their event, version and build
MAX_SKIPPED = 1000
MAX_ENDED = 10_000
SNAPSHOT_FORMAT = 1


class Event(str, Enum):
    """Event in a map's log."""

    PUBLISHED = "published"
    ACTIVATED = "activated"
    RETIRED = "retired"
    COLLECTED = "collected"  # a publication that never ended was given up


@dataclass(frozen=True)
class LogEntry:
    """Entry of a map's log.

    Attributes:
        seq: number of the entry: 1, 2, ...
        time: time of writing, UTC, ISO 8601, for people; ``seq`` gives the order.
        build_id: build that caused the event; empty if a person did.
        writer: unique to one append, so that a writer whose reply was lost recognises its own entry.
        generation: generation of the version's files, for ``published``.
        provisional: the version is provisional, for ``published``.
        provenance, summary: of the version, for ``published`` (``firstfix.catalog.provenance``).
    """

    seq: int
    event: Event
    version: str
    time: str
    build_id: str = ""
    writer: str = ""
    generation: int = 0
    provisional: bool = False
    provenance: Mapping[str, Any] = field(default_factory=dict, hash=False)
    summary: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def to_mapping(self) -> dict[str, Any]:
        """JSON-ready form."""
        values = {**asdict(self), "event": self.event.value}
        for name in ("provenance", "summary"):
            if not values[name]:
                del values[name]
        return values

    def to_json(self) -> bytes:
        """Content of the entry's object."""
        values = self.to_mapping()
        del values["seq"]  # it is the object's name
        return record_json(values)

    @classmethod
    def parse(cls, seq: int, record: dict[str, Any]) -> LogEntry | None:
        """Parse an entry's record. Returns None for an event of a later release.

        Raises:
            ValueError, KeyError, TypeError, InvalidOption: it is not an entry.
        """
        time = text_of(record, "time")
        if datetime.fromisoformat(time).tzinfo is None:
            raise ValueError("its time has no zone")
        event, version = text_of(record, "event"), check_version(text_of(record, "version"))
        known = {one.value: one for one in Event}
        if event not in known:
            return None  # of a later release
        build_id, writer = text_of(record, "build_id"), text_of(record, "writer")
        generation = whole_number_of(record, "generation")
        provisional = record["provisional"]
        if type(provisional) is not bool:
            raise TypeError("provisional is no boolean")
        told = [record.get(name, {}) for name in ("provenance", "summary")]
        if not all(isinstance(values, dict) for values in told):
            raise TypeError("provenance or summary is no object")
        return cls(seq, known[event], version, time, build_id, writer, generation, provisional, *told)


@dataclass(frozen=True)
class MapState:
    """Sum of a log's entries.

    Attributes:
        entries: in order: the newest, and older ones that still matter. These are the publications of
            versions that can be served, and the last entry of each event, version and build.
        published: versions that can be served, in the order of their first publication.
        activated: those of them that were ever active, latest activation first: the active version, then
            those to fall back to.
        last_seq: number of the last entry, damaged or not; 0 for an empty log.
        skipped: numbers of missing or damaged entries.
        generations: generation of each published version.
        ended: version to ``seq`` of the entry that ended its last generation, newest ones only.
        exists: the map has or had a version to serve.
    """

    entries: tuple[LogEntry, ...] = ()
    published: tuple[str, ...] = ()
    activated: tuple[str, ...] = ()
    last_seq: int = 0
    skipped: tuple[int, ...] = ()
    generations: Mapping[str, int] = field(default_factory=dict)
    ended: Mapping[str, int] = field(default_factory=dict)
    exists: bool = False

    def generation(self, version: str) -> int:
        """Generation of a version's files, or for an unpublished version the one to put them into.

        It is 0, or the ``seq`` of the entry that ended the generation before.
        """
        return self.generations.get(version, self.ended.get(version, 0))

    @property
    def active(self) -> str | None:
        """Version that the map serves."""
        return self.activated[0] if self.activated else None

    @property
    def doubtful(self) -> tuple[int, ...]:
        """Numbers of skipped entries after the last activation: one may have changed the active version."""
        last = max((e.seq for e in self.entries if e.event is Event.ACTIVATED), default=0)
        return tuple(number for number in self.skipped if number > last)

    @property
    def provisional(self) -> frozenset[str]:
        """The published versions that are provisional."""
        found = {e.version: e.provisional for e in self.entries if e.event is Event.PUBLISHED}
        return frozenset(version for version in self.published if found.get(version, False))

    def published_by(self, build_id: str) -> frozenset[str]:
        """The versions that can be served and that a build has published first."""
        return frozenset(
            entry.version
            for entry in self.entries
            if (entry.event, entry.build_id) == (Event.PUBLISHED, build_id)
            and entry.version in self.published
        )

    @property
    def has_full(self) -> bool:
        """A version that is not provisional can be served."""
        return len(self.provisional) < len(self.published)

    @classmethod
    def of(cls, entries: Sequence[LogEntry], last_seq: int) -> MapState:
        """State after all entries of a log."""
        return cls().after(entries, last_seq)

    def after(self, entries: Sequence[LogEntry], last_seq: int, skipped: Iterable[int] = ()) -> MapState:
        """State after further entries."""
        published, activated = list(self.published), list(self.activated)
        generations, ended, exists = dict(self.generations), dict(self.ended), self.exists
        for entry in entries:
            version = entry.version
            if entry.event is Event.PUBLISHED:
                exists = True
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
        ended = dict(sorted(ended.items(), key=lambda item: item[1])[-MAX_ENDED:])
        kept = _relevant((*self.entries, *entries), published)
        all_skipped = tuple(sorted({*self.skipped, *skipped}))[-MAX_SKIPPED:]
        return MapState(
            kept, tuple(published), tuple(activated), last_seq, all_skipped, generations, ended, exists
        )

    def to_json(self) -> bytes:
        """Content of a snapshot."""
        values = {**asdict(self), "format": SNAPSHOT_FORMAT}
        values["entries"] = [entry.to_mapping() for entry in self.entries]
        return record_json(values)

    @classmethod
    def parse(cls, last_seq: int, record: dict[str, Any]) -> MapState:
        """Parse a snapshot.

        Args:
            last_seq: number in the snapshot's name.

        Raises:
            ValueError, KeyError, TypeError, InvalidOption: it is not a snapshot, has another number, or is of
                a later release.
        """
        if record["format"] != SNAPSHOT_FORMAT or record["last_seq"] != last_seq:
            raise ValueError(f"it is not snapshot {last_seq} of format {SNAPSHOT_FORMAT}")
        entries: list[LogEntry] = []
        for values in record["entries"]:
            entry = LogEntry.parse(whole_number_of(values, "seq"), values)
            if entry is None or not (entries[-1].seq if entries else 0) < entry.seq <= last_seq:
                raise ValueError("its entries are not in order")
            entries.append(entry)
        published = tuple(check_version(version) for version in record["published"])
        activated = tuple(check_version(version) for version in record["activated"])
        if not set(activated) <= set(published):
            raise ValueError("a version is active that is not published")
        skipped = tuple(record["skipped"])
        if not all(type(number) is int for number in skipped):
            raise TypeError("the numbers of skipped entries are not integers")
        generations, ended = (
            {check_version(version): whole_number_of(numbers, version) for version in numbers}
            for numbers in (record["generations"], record["ended"])
        )
        if set(generations) != set(published) or type(record["exists"]) is not bool:
            raise ValueError("generations must number each published version, exists must be true or false")
        exists: bool = record["exists"]
        return cls(tuple(entries), published, activated, last_seq, skipped, generations, ended, exists)


def _relevant(entries: Sequence[LogEntry], published: Iterable[str]) -> tuple[LogEntry, ...]:
    """Entries to keep. Applied step by step it keeps the same as applied to all entries at once."""
    last_of_kind = {(entry.event, entry.version, entry.build_id): entry.seq for entry in entries}
    last_publication = {entry.version: entry.seq for entry in entries if entry.event is Event.PUBLISHED}
    kept = {entry.seq for entry in entries[-HISTORY:]}
    kept.update(sorted(last_of_kind.values())[-MARKS:])
    kept.update(last_publication[version] for version in published)
    return tuple(entry for entry in entries if entry.seq in kept)
