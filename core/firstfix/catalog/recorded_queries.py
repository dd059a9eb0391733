"""Recorded queries: stored as they were received, for inspection and replay.

    recorded-queries/<query_id>.body    body of the query, in its own encoding
    recorded-queries/<query_id>.json    request and answer; written last: without it there is none

Ids begin with the time, so that they sort by age.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime, timedelta, timezone
from typing import Any

from ..errors import InvalidOption, NotFound, UnreadableRecord
from ..store.json_record import RecordKind, read_record, record_json, text_of, texts_of, whole_number_of
from ..store.store import Store

FOLDER = "recorded-queries"
MAX_DECODED_BYTES = 1 << 30  # of a body, where a tool decodes it in its own process
REPLAY = "replay-"  # prefix of the request id of a replayed query, which is not recorded again
TOLD_BY, TOLD_AT = "told_by", "told_at"
_ID = re.compile(r"(\d{8}t\d{12})-[0-9a-f]{8}")
_TIME_FORM = "%Y%m%dt%H%M%S%f"


@dataclass(frozen=True)
class RecordedQuery:
    """Recorded query without its body.

    Attributes:
        query_id: time and 8 random hex characters.
        time: time of the answer, UTC, ISO 8601.
        map_id: as in the request: one, several separated by commas, or empty.
        options: as in the request, in the form of ``LocalizeOptions.from_strings``.
        answer: ``Localization.to_mapping``.
        truth: where the scan was taken, as people have told since: ``map_id`` and ``T_map_sensor``, in the
            form of the answer; ``told_by``, the caller's name, and ``told_at``, UTC, ISO 8601. Empty if
            nobody has told.
        body_sha256: of the body, as hex.
        robot: ``robot_of`` the caller; empty if nobody can tell it apart.
    """

    query_id: str
    time: str
    transport: str
    request_id: str
    trace_id: str
    map_id: str
    media_type: str
    content_encoding: str
    options: Mapping[str, str]
    answer: Mapping[str, Any]
    body_bytes: int
    service_version: str = field(default="")
    truth: Mapping[str, Any] = field(default_factory=dict)
    body_sha256: str = ""
    robot: str = ""

    def is_about(self, map_id: str) -> bool:
        """Whether the map is in the request or the answer."""
        return map_id in self.maps

    @property
    def maps(self) -> frozenset[str]:
        """Ids of the maps in the request and in the answer. Empty: any map was asked and none is answered."""
        return frozenset(filter(None, (*self.map_id.split(","), self.answer.get("map_id"))))


class RecordedQueries:
    """Recorded queries in a store. Thread-safe.

    Every method raises StoreUnavailable or StoreError if the store fails, and InvalidOption for an invalid
    id.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def put(self, recorded: RecordedQuery, body: bytes) -> None:
        """Store a recorded query."""
        self._store.put(_key(recorded.query_id, "body"), body)
        self._put_record(replace(recorded, body_sha256=hashlib.sha256(body).hexdigest()))

    def ids(self) -> list[str]:
        """Ids of all recorded queries, oldest first."""
        names = [key.rpartition("/")[2] for key in self._store.list(FOLDER)]
        return [name[: -len(".json")] for name in names if name.endswith(".json") and _ID.match(name)]

    def get(self, query_id: str) -> RecordedQuery:
        """Read a recorded query.

        Raises:
            NotFound: no such recorded query, or it was removed.
            UnreadableRecord: its record is damaged.
        """
        try:
            return read_record(
                self._store, _key(query_id, "json"), RecordKind.RECORDED_QUERY, parse_recorded_query
            )
        except NotFound:
            raise NotFound(f"no recorded query {query_id}") from None

    def each(self) -> Iterator[RecordedQuery]:
        """Read all recorded queries, oldest first. Skips damaged ones and those removed meanwhile."""
        for query_id in self.ids():
            if (recorded := self.find(query_id)) is not None:
                yield recorded

    def find(self, query_id: str) -> RecordedQuery | None:
        """Read a recorded query. Returns None if it is damaged or was removed."""
        with suppress(NotFound, UnreadableRecord):
            return self.get(query_id)
        return None

    def body(self, query_id: str) -> bytes:
        """Body of a recorded query.

        Raises:
            NotFound: no such recorded query, or it was removed.
            UnreadableRecord: the body is not the one that its record describes, or the record is damaged.
        """
        body = self._store.get(_key(query_id, "body"))
        sha256 = self.get(query_id).body_sha256
        if hashlib.sha256(body).hexdigest() != sha256:
            raise UnreadableRecord(
                f"the body of recorded query {query_id} is damaged", RecordKind.RECORDED_QUERY.value
            )
        return body

    def ids_told_first(self) -> list[str]:
        """Ids of all recorded queries. First those with a record much newer than the body: a truth was told.

        Whoever looks for truths among very many recorded queries so finds them without reading all.
        """
        times: dict[str, dict[str, float]] = {}
        for item in self._store.scan(FOLDER):
            name, _, ending = item.key.rpartition("/")[2].rpartition(".")
            if _ID.fullmatch(name):
                times.setdefault(name, {})[ending] = item.last_modified.timestamp()
        newer_s = {
            name: at["json"] - at.get("body", at["json"]) for name, at in times.items() if "json" in at
        }
        return sorted(newer_s, key=lambda name: (-newer_s[name], name))

    def set_truth(self, query_id: str, truth: Mapping[str, Any], told_by: str = "") -> RecordedQuery:
        """Note where the scan of a recorded query was taken; empty: it is not known. The last word is valid.

        Args:
            told_by: name of who says so, as a caller is named; empty: nobody in particular.

        Raises:
            NotFound, UnreadableRecord: see ``get``.
        """
        now = datetime.now(timezone.utc).isoformat(timespec="seconds")
        told = {**truth, TOLD_BY: told_by, TOLD_AT: now} if truth else {}
        recorded = replace(self.get(query_id), truth=told)
        self._put_record(recorded)
        if not self._store.exists(_key(query_id, "body")):  # removed meanwhile: it must not come back
            self._store.delete(_key(query_id, "json"))
            raise NotFound(f"no recorded query {query_id}")
        return recorded

    def delete(self, query_id: str) -> None:
        """Remove a recorded query. A missing recorded query is no error."""
        # The record first: without it there is no query. And last: ``set_truth`` may have put it again before
        # the body was gone.
        for ending in ("json", "body", "json"):
            self._store.delete(_key(query_id, ending))

    def _put_record(self, recorded: RecordedQuery) -> None:
        self._store.put(_key(recorded.query_id, "json"), record_json(asdict(recorded)))

    def prune(self, *, older_than_s: float, max_bytes: int) -> int:
        """Remove queries of this age by the store's clock, then the oldest until ``max_bytes`` are left.

        Returns:
            Size of the rest in bytes.
        """
        cutoff = self._store.now() - timedelta(seconds=older_than_s)
        sizes: dict[str, int] = {}
        times: dict[str, datetime] = {}
        for item in self._store.scan(FOLDER):
            name = item.key.rpartition("/")[2].rpartition(".")[0]
            if _ID.fullmatch(name):
                sizes[name] = sizes.get(name, 0) + item.size_bytes
                times[name] = max(times.get(name, item.last_modified), item.last_modified)
        left = sum(sizes.values())
        for query_id in sorted(times, key=lambda name: (times[name], name)):
            if times[query_id] >= cutoff and left <= max_bytes:
                break
            self.delete(query_id)
            left -= sizes[query_id]
        return left


def parse_recorded_query(record: dict[str, Any]) -> RecordedQuery:
    """Parse the record of a recorded query.

    Raises:
        ValueError, KeyError, TypeError: it is not the record of a recorded query.
    """
    recorded = RecordedQuery(**record)
    for one in fields(RecordedQuery):
        if one.name not in ("options", "answer", "body_bytes", "truth"):
            text_of(record, one.name)
    whole_number_of(record, "body_bytes")
    if not isinstance(recorded.options, dict) or not isinstance(recorded.truth, dict):
        raise TypeError("options or truth is not an object")
    for name in (TOLD_BY, TOLD_AT):
        text_of(record["truth"], name, "")
    text_of(record["answer"], "verdict")
    texts_of(record["answer"], "reasons")
    float(record["answer"]["probability"])
    return recorded


def robot_of(caller: str) -> str:
    """Pseudonym of a robot: a hash of the caller's name, which is ``key:<key id>`` or ``jwt:<subject>``.

    A robot is a credential. Callers without one, who are told apart by their address alone, have no
    pseudonym: whoever has many addresses would be many robots.
    """
    if not caller.startswith(("key:", "jwt:")):
        return ""
    return hashlib.sha256(f"robot {caller}".encode()).hexdigest()[:16]


def new_query_id(random_hex: str, now: datetime) -> str:
    """Make an id from 8 hex characters and a UTC time."""
    return f"{now.strftime(_TIME_FORM)}-{random_hex}"


def _key(query_id: str, ending: str) -> str:
    if not _ID.fullmatch(query_id):
        raise InvalidOption(f"not the id of a recorded query: {query_id[:80]!r}")
    return f"{FOLDER}/{query_id}.{ending}"
