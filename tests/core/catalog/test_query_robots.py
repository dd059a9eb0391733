"""Kept queries: their bodies, their truths, and the robots that asked."""

from __future__ import annotations

import pytest

from firstfix.catalog.query_samples import QuerySample, QuerySamples, robot_of
from firstfix.errors import UnreadableRecord
from firstfix.store.store import Store

ANSWER = {"verdict": "localized", "reasons": [], "probability": 0.99}
SAMPLE_ID = "20260101t000000000000-0000000a"


def kept(robot: str) -> tuple[Store, QuerySamples]:
    store = Store.open("memory://")
    samples = QuerySamples(store)
    samples.put(
        QuerySample(SAMPLE_ID, "2026-01-01", "http", "r", "", "hall", "x/y", "", {}, ANSWER, 4, robot=robot),
        b"body",
    )
    return store, samples


def test_a_robot_is_a_credential():
    assert robot_of("key:k1") != robot_of("key:k2")
    assert robot_of("key:k1") == robot_of("key:k1")
    assert "k1" not in robot_of("key:k1")
    assert robot_of("jwt:somebody@example.org")
    assert robot_of("address:10.0.0.7") == robot_of("anybody") == robot_of("") == ""


def test_the_robot_of_a_query_is_kept_and_no_part_of_its_answer():
    _, samples = kept(robot_of("key:k1"))
    sample = samples.get(SAMPLE_ID)
    assert sample.robot == robot_of("key:k1")
    assert sample.answer == ANSWER
    samples.set_truth(SAMPLE_ID, {"map_id": "hall"})
    assert samples.get(SAMPLE_ID).robot == robot_of("key:k1")


def test_who_has_told_a_truth_is_kept_with_it():
    _, samples = kept("")
    samples.set_truth(SAMPLE_ID, {"map_id": "hall"}, "key:k1")
    sample = samples.get(SAMPLE_ID)
    assert (sample.truth["map_id"], sample.truth["told_by"]) == ("hall", "key:k1")
    assert sample.answer == ANSWER
    samples.set_truth(SAMPLE_ID, {})
    assert samples.get(SAMPLE_ID).truth == {}


def test_a_body_that_its_record_does_not_describe_is_unreadable():
    store, samples = kept("")
    assert samples.body(SAMPLE_ID) == b"body"
    store.put(f"samples/{SAMPLE_ID}.body", b"bodx")
    with pytest.raises(UnreadableRecord, match="damaged"):
        samples.body(SAMPLE_ID)
