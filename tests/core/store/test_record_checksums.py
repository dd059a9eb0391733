"""Checksums of records: no flipped bit passes for a value."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from firstfix.catalog.geopose import Georeference
from firstfix.catalog.georeferences import parse_georeference
from firstfix.catalog.log.map_state import Event, LogEntry
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery, parse_recorded_query
from firstfix.store.json_record import CHECKSUM, RecordKind, parse_record, record_json
from firstfix.store.store import Store

ENTRY = LogEntry(4, Event.ACTIVATED, "a" * 64, "2026-01-01T00:00:00+00:00", "b1", "w", 3)
GEOREFERENCE = Georeference(47.107739, 11.5, 500.25, (0.0, 0.0, 0.0, 1.0))
ANSWER = {"verdict": "localized", "reasons": [], "probability": 0.98}
RECORDED = RecordedQuery(
    "20260101t000000000000-0000000a", "2026-01-01", "http", "r", "", "hall", "x/y", "", {}, ANSWER, 4
)


READERS: dict[RecordKind, Callable[[dict[str, Any]], Any]] = {
    RecordKind.LOG_ENTRY: lambda record: LogEntry.parse(4, record),
    RecordKind.GEOREFERENCE: parse_georeference,
    RecordKind.RECORDED_QUERY: parse_recorded_query,
}


def read(kind: RecordKind, data: bytes) -> Any:
    return parse_record(data, kind, READERS[kind])


def stored_query(truth: dict[str, Any]) -> bytes:
    store = Store.open("memory://")
    RecordedQueries(store).put(RECORDED, b"body")
    RecordedQueries(store).set_truth(RECORDED.query_id, truth)
    return store.get(f"recorded-queries/{RECORDED.query_id}.json")


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (RecordKind.LOG_ENTRY, ENTRY.to_json()),
        (RecordKind.GEOREFERENCE, record_json(GEOREFERENCE.to_mapping())),
        (RecordKind.RECORDED_QUERY, stored_query({})),
        (RecordKind.RECORDED_QUERY, stored_query({"map_id": "hall"})),
    ],
    ids=["log entry", "georeference", "recorded query", "recorded query with a truth"],
)
def test_a_flipped_bit_is_refused_or_harmless(kind: RecordKind, data: bytes):
    right, refused = read(kind, data), 0
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        try:
            found = read(kind, bytes(flipped))
        except ValueError:
            refused += 1
        else:
            assert found == right, f"bit {bit}: {bytes(flipped)!r}"
    assert refused > 0.8 * 8 * len(data)


def test_a_record_without_a_right_checksum_is_refused():
    for kind, written in (
        (RecordKind.LOG_ENTRY, ENTRY.to_json()),
        (RecordKind.RECORDED_QUERY, stored_query({"map_id": "hall"})),
    ):
        record = json.loads(written)
        without = {name: value for name, value in record.items() if name != CHECKSUM}
        for damaged in ({**record, CHECKSUM: "0" * 64}, {**record, CHECKSUM: None}, without):
            with pytest.raises(ValueError, match="checksum"):
                read(kind, json.dumps(damaged).encode())


def test_an_event_of_a_later_release_is_none():
    record = {**json.loads(ENTRY.to_json()), "event": "renamed"}
    del record[CHECKSUM]
    assert read(RecordKind.LOG_ENTRY, record_json(record)) is None
