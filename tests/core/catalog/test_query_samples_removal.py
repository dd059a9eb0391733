"""Kept queries that are removed while somebody notes where they were taken."""

from __future__ import annotations

from contextlib import suppress

import pytest

from firstfix.catalog.query_samples import QuerySample, QuerySamples
from firstfix.errors import NotFound
from firstfix.store.store import Store
from tests.interleavings import Step, run_every_order, run_interleaved

ID = "20261123t120000000000-0123abcd"
ANSWER = {"verdict": "rejected", "reasons": [], "probability": 0.1, "map_id": "hall"}


def kept(store: Store) -> QuerySamples:
    samples = QuerySamples(store)
    sample = QuerySample(ID, "2026-11-23T12:00:00Z", "http", "r", "", "hall", "x", "", {}, ANSWER, 4)
    samples.put(sample, b"body")
    return samples


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


def test_a_truth_that_comes_after_the_removal_is_refused(monkeypatch: pytest.MonkeyPatch):
    store = Store.open("memory://")
    samples = kept(store)
    read = samples.get(ID)
    samples.delete(ID)
    monkeypatch.setattr(samples, "get", lambda sample_id: read)
    with pytest.raises(NotFound, match=ID):
        samples.set_truth(ID, {"map_id": "hall"})
    assert store.list("samples") == []
