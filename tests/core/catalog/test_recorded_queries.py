"""Kept queries: their robots (pseudonyms of credentials), their truths, and their removal."""

from __future__ import annotations

from contextlib import suppress

import pytest

from firstfix.catalog.recorded_queries import QuerySample, QuerySamples, robot_of
from firstfix.errors import NotFound, UnreadableRecord
from firstfix.store.store import Store
from tests.interleavings import Step, run_every_order, run_interleaved

ANSWER = {"verdict": "localized", "reasons": [], "probability": 0.99}
ID = "20260101t000000000000-0000000a"


def kept(store: Store, robot: str = "") -> QuerySamples:
    sample = QuerySample(ID, "2026-01-01", "http", "r", "", "hall", "x/y", "", {}, ANSWER, 4, robot=robot)
    QuerySamples(store).put(sample, b"body")
    return QuerySamples(store)


def test_a_robot_is_the_pseudonym_of_a_credential():
    assert robot_of("key:k1") != robot_of("key:k2")
    assert robot_of("key:k1") == robot_of("key:k1")
    assert "k1" not in robot_of("key:k1")
    assert robot_of("jwt:somebody@example.org")
    assert robot_of("address:10.0.0.7") == robot_of("anybody") == robot_of("") == ""


def test_the_robot_of_a_query_is_kept_and_no_part_of_its_answer(store: Store):
    samples = kept(store, robot_of("key:k1"))
    sample = samples.get(ID)
    assert sample.robot == robot_of("key:k1")
    assert sample.answer == ANSWER
    samples.set_truth(ID, {"map_id": "hall"})
    assert samples.get(ID).robot == robot_of("key:k1")


def test_the_teller_of_a_truth_is_kept_with_it_alone(store: Store):
    samples = kept(store)
    samples.set_truth(ID, {"map_id": "hall"}, "key:k1")
    sample = samples.get(ID)
    assert (sample.truth["map_id"], sample.truth["told_by"]) == ("hall", "key:k1")
    assert sample.answer == ANSWER
    samples.set_truth(ID, {})
    assert samples.get(ID).truth == {}


def test_a_damaged_body_is_unreadable(store: Store):
    samples = kept(store)
    assert samples.body(ID) == b"body"
    store.put(f"samples/{ID}.body", b"bodx")
    with pytest.raises(UnreadableRecord, match="damaged"):
        samples.body(ID)


def test_a_removed_sample_does_not_come_back_with_its_truth(monkeypatch: pytest.MonkeyPatch):
    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        samples = kept(store)

        def tell() -> None:
            with suppress(NotFound):
                samples.set_truth(ID, {"map_id": "hall"})

        works = [tell, lambda: QuerySamples(store).delete(ID)]
        steps = run_interleaved(works, switches, monkeypatch=monkeypatch)
        assert store.list("samples") == []
        return steps

    run_every_order(run)


def test_a_truth_that_comes_after_the_removal_is_refused(store: Store, monkeypatch: pytest.MonkeyPatch):
    samples = kept(store)
    read = samples.get(ID)
    samples.delete(ID)
    monkeypatch.setattr(samples, "get", lambda sample_id: read)
    with pytest.raises(NotFound, match=ID):
        samples.set_truth(ID, {"map_id": "hall"})
    assert store.list("samples") == []
