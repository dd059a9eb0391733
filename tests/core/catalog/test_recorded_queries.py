"""Recorded queries: their robots (pseudonyms of credentials), their truths, and their removal."""

from __future__ import annotations

from contextlib import suppress

import pytest

from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery, robot_of
from firstfix.errors import NotFound, UnreadableRecord
from firstfix.store.store import Store
from tests.interleavings import Step, run_every_order, run_interleaved

ANSWER = {"verdict": "localized", "reasons": [], "probability": 0.99}
ID = "20260101t000000000000-0000000a"


def stored(store: Store, robot: str = "") -> RecordedQueries:
    recorded = RecordedQuery(ID, "2026-01-01", "http", "r", "", "hall", "x/y", "", {}, ANSWER, 4, robot=robot)
    RecordedQueries(store).put(recorded, b"body")
    return RecordedQueries(store)


def test_a_robot_is_the_pseudonym_of_a_credential():
    assert robot_of("key:k1") != robot_of("key:k2")
    assert robot_of("key:k1") == robot_of("key:k1")
    assert "k1" not in robot_of("key:k1")
    assert robot_of("jwt:somebody@example.org")
    assert robot_of("address:10.0.0.7") == robot_of("anybody") == robot_of("") == ""


def test_the_robot_of_a_query_is_kept_and_no_part_of_its_answer(store: Store):
    recorded_queries = stored(store, robot_of("key:k1"))
    recorded = recorded_queries.get(ID)
    assert recorded.robot == robot_of("key:k1")
    assert recorded.answer == ANSWER
    recorded_queries.set_truth(ID, {"map_id": "hall"})
    assert recorded_queries.get(ID).robot == robot_of("key:k1")


def test_the_teller_of_a_truth_is_kept_with_it_alone(store: Store):
    recorded_queries = stored(store)
    recorded_queries.set_truth(ID, {"map_id": "hall"}, "key:k1")
    recorded = recorded_queries.get(ID)
    assert (recorded.truth["map_id"], recorded.truth["told_by"]) == ("hall", "key:k1")
    assert recorded.answer == ANSWER
    recorded_queries.set_truth(ID, {})
    assert recorded_queries.get(ID).truth == {}


def test_a_damaged_body_is_unreadable(store: Store):
    recorded_queries = stored(store)
    assert recorded_queries.body(ID) == b"body"
    store.put(f"recorded-queries/{ID}.body", b"bodx")
    with pytest.raises(UnreadableRecord, match="damaged"):
        recorded_queries.body(ID)


def test_a_removed_query_does_not_come_back_with_its_truth(monkeypatch: pytest.MonkeyPatch):
    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        recorded_queries = stored(store)

        def tell() -> None:
            with suppress(NotFound):
                recorded_queries.set_truth(ID, {"map_id": "hall"})

        works = [tell, lambda: RecordedQueries(store).delete(ID)]
        steps = run_interleaved(works, switches, monkeypatch=monkeypatch)
        assert store.list("recorded-queries") == []
        return steps

    run_every_order(run)


def test_a_truth_that_comes_after_the_removal_is_refused(store: Store, monkeypatch: pytest.MonkeyPatch):
    recorded_queries = stored(store)
    read = recorded_queries.get(ID)
    recorded_queries.delete(ID)
    monkeypatch.setattr(recorded_queries, "get", lambda query_id: read)
    with pytest.raises(NotFound, match=ID):
        recorded_queries.set_truth(ID, {"map_id": "hall"})
    assert store.list("recorded-queries") == []
