"""Verification of the bodies of kept queries, and of the parts of uploads."""

from __future__ import annotations

import hashlib

import pytest

from firstfix.catalog.query_samples import QuerySample, QuerySamples
from firstfix.catalog.uploads import parts
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.maintenance.verify import Verification
from firstfix.store.store import Store

SAMPLE_ID = "20260101t000000000000-0000000a"
BODY, RECORD = f"samples/{SAMPLE_ID}.body", f"samples/{SAMPLE_ID}.json"


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> Store:
    """One kept query; an upload that is whole, and one under way, in parts of three bytes."""
    monkeypatch.setattr(parts, "PART_BYTES", 3)
    store = Store.open("memory://")
    answer = {"verdict": "rejected", "reasons": [], "probability": 0.1}
    sample = QuerySample(SAMPLE_ID, "2026-01-01", "http", "r", "", "hall", "x/y", "", {}, answer, 4)
    QuerySamples(store).put(sample, b"body")
    uploads = Uploads(store)
    for upload_id, size_bytes in (("whole", 8), ("half", 9)):
        uploads.create(upload_id, size_bytes=size_bytes, file_name="a.ply")
        for data in (b"abc", b"def", b"gh"):
            uploads.append(uploads.get(upload_id), data)
    uploads.finish(uploads.get("whole"))
    return store


def findings(store: Store) -> dict[str, str]:
    return {finding.key: finding.problem for finding in Verification(store).run().findings}


def part(upload_id: str, offset: int) -> str:
    return f"uploads/{upload_id}/parts/{offset:020d}"


def test_bodies_in_order_are_read_and_counted(store: Store):
    report = Verification(store).run()
    assert report.findings == []
    assert report.kinds["sample_body"] == 1
    assert report.kinds["upload_part"] == 6
    assert report.kinds["upload"] == 2
    assert sum(report.kinds.values()) == report.objects


@pytest.mark.parametrize(("data", "why"), [(b"bodx", "sha256"), (b"bod", "3 bytes"), (None, "missing")])
def test_the_body_of_a_kept_query(store: Store, data: bytes | None, why: str):
    store.delete(BODY) if data is None else store.put(BODY, data)
    found = findings(store)
    assert found.keys() == {BODY}
    assert why in found[BODY]


def test_the_parts_of_a_whole_upload(store: Store):
    record = "uploads/whole/upload.json"
    store.put(part("whole", 3), b"dEf")
    assert findings(store) == {record: "the body has another sha256 than its record says"}
    store.put(part("whole", 3), b"de")
    assert findings(store) == {record: "a part is missing or cut off at byte 5 of 8"}
    store.delete(part("whole", 3))
    assert findings(store) == {record: "a part is missing or cut off at byte 3 of 8"}


def test_the_announced_sha256_of_an_upload_counts(store: Store):
    uploads = Uploads(store)
    uploads.create("told", size_bytes=3, file_name="a.ply", sha256=hashlib.sha256(b"abc").hexdigest())
    uploads.append(uploads.get("told"), b"abc")
    assert findings(store) == {}
    store.put(part("told", 0), b"abd")
    assert findings(store).keys() == {"uploads/told/upload.json"}


def test_the_parts_of_an_upload_under_way(store: Store):
    record = "uploads/half/upload.json"
    store.delete(part("half", 6))
    assert findings(store) == {}, "the sender goes on from there"
    store.put(part("half", 6), b"gh")
    store.put(part("half", 3), b"de")
    assert findings(store) == {record: "a part is missing or cut off at byte 5 of 9"}
    store.delete(part("half", 3))
    assert findings(store) == {record: "a part is missing or cut off at byte 3 of 9"}
