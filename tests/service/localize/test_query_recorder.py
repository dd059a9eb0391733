"""Samples of queries that were not localized: stored by the settings, listed and replayed."""

from __future__ import annotations

import gzip
import json
import os
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.catalog.recorded_queries import QuerySample, QuerySamples, new_sample_id
from firstfix.errors import InvalidOption, NotFound, StoreUnavailable
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix_service.auth.principal import Principal
from firstfix_service.localize.query_recorder import MAX_WAITING, QuerySampler, SamplePolicy
from firstfix_service.query_workers.answer_form import AnswerForm
from firstfix_service.query_workers.encoded_answer import encoded_answer
from firstfix_service.query_workers.query import AsGiven, Query
from firstfix_service.telemetry.metrics import Metrics
from tests.commands import firstfix
from tests.service.access_world import KEYED, bearer, known
from tests.service.service_world import SCAN_BODY, XYZ, Behaviour, FakeLocalizer, Service, served
from tests.waiting import wait_until

LOCALIZED_POINTS = 200  # a scan of so many is localized, every other one rejected


def judged(localizer: FakeLocalizer, scan: Scan, *_: object) -> Localization:
    T = np.eye(4)
    T[0, 3] = localizer.label
    place = Hypothesis(T, AlignmentQuality(0.4, 0.3, 0.1), 0.4, 3)
    if len(scan) == LOCALIZED_POINTS:
        return Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.9, (place,))
    return Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,), probability=0.4, hypotheses=(place,))


def judging(directory: Path, **changes: Any) -> AbstractContextManager[Service]:
    return served(directory, behaviour=Behaviour(answers=judged), **changes)


@pytest.fixture
def service(tmp_path) -> Iterator[Service]:
    with judging(tmp_path, samples_share=1.0) as running:
        running.wait_until_loaded()
        yield running


def kept_by(service: Service) -> QuerySamples:
    return QuerySamples(service.catalog.store)


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_rejected_query_is_recorded_as_it_came(service: Service, transport: str):
    body = gzip.compress(SCAN_BODY)
    options = {"min_probability": "0.5"}
    reply = service.ask(transport, body=body, content_encoding="gzip", options=options)
    kept = kept_by(service)
    wait_until(lambda: len(kept.ids()) == 1)
    sample = kept.get(kept.ids()[0])
    assert kept.body(sample.sample_id) == body
    assert (sample.media_type, sample.content_encoding) == (XYZ, "gzip")
    assert (sample.transport, sample.map_id, sample.options) == (transport, "hall", options)
    assert sample.body_bytes == len(body)
    assert {**reply.json, "timings_ms": 0} == {**sample.answer, "timings_ms": 0}
    assert len(sample.request_id) == 32
    assert sample.robot == "", "nobody can tell who asked"
    age = datetime.now(timezone.utc) - datetime.fromisoformat(sample.time)
    assert timedelta(0) <= age < timedelta(minutes=1)


def test_a_localized_query_is_not_recorded(service: Service):
    assert service.ask("http", body=bytes(12 * LOCALIZED_POINTS)).json["verdict"] == "localized"
    service.ask("http")  # kept after the other would have been
    wait_until(lambda: kept_by(service).ids())
    assert len(kept_by(service).ids()) == 1
    wait_until(lambda: service.value("firstfix_samples_total", result="kept") == 1)


def test_nothing_is_recorded_by_default(tmp_path: Path):
    before = set(threading.enumerate())  # other services may run in this process
    with judging(tmp_path, zenoh=False) as service:
        assert service.ask("http").json["verdict"] == "rejected"
        assert "query-sampler" not in {thread.name for thread in set(threading.enumerate()) - before}
    assert not (tmp_path / "store" / "samples").exists()


def test_samples_may_have_a_store_of_their_own(tmp_path: Path):
    elsewhere = tmp_path / "elsewhere"
    with judging(tmp_path, zenoh=False, samples_share=1.0, samples_store=str(elsewhere)) as service:
        assert service.ask("http").ok
    assert len(list((elsewhere / "samples").glob("*.body"))) == 1, "written before the service stopped"
    assert not (tmp_path / "store" / "samples").exists()


# What is kept, and what is not


POLICY: dict[str, Any] = {
    "share": 1.0,
    "share_localized": 0.0,
    "per_minute": 100,
    "max_body_bytes": 2000,
    "max_bytes": 10**9,
    "max_age_s": 86400.0,
}
REJECTED = encoded_answer(Localization(Verdict.REJECTED, (Reason.NO_CANDIDATE,)))
LOCALIZED = encoded_answer(Localization(Verdict.LOCALIZED, (), np.eye(4), None, np.eye(6), 0.9))


QUERY = Query.read(AsGiven(("hall",), XYZ), AnswerForm(), Principal("robot"), lambda: (), 0.0)


class Kept:
    """A sampler over a file store, with its counters."""

    def __init__(self, directory: Path, **changes: Any) -> None:
        self.samples = QuerySamples(Store.open(str(directory)))
        self.metrics = Metrics()
        self.sampler = QuerySampler(self.samples, SamplePolicy(**{**POLICY, **changes}), self.metrics)

    def count(self, result: str) -> float:
        return self.metrics.registry.get_sample_value("firstfix_samples_total", {"result": result}) or 0.0

    def finish(self) -> None:
        self.sampler.start()
        self.sampler.close()


def test_a_share_of_queries_is_recorded(tmp_path: Path):
    kept = Kept(tmp_path, share=0.5, per_minute=6000)
    for _ in range(60):
        kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    kept.finish()
    assert 10 <= len(kept.samples.ids()) <= 50, "60 coins"


@pytest.mark.parametrize(("share", "count"), [(0.0, 0), (1.0, 1)])
def test_localized_queries_have_a_share_of_their_own(tmp_path: Path, share: float, count: int):
    kept = Kept(tmp_path, share=0.0, share_localized=share)
    kept.sampler.offer(QUERY, bytes(100), LOCALIZED, None)
    kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    kept.finish()
    assert len(kept.samples.ids()) == count


def test_the_rate_and_the_size_are_limited(tmp_path: Path):
    kept = Kept(tmp_path, per_minute=3)
    kept.sampler.offer(QUERY, bytes(2001), REJECTED, None)
    for _ in range(5):
        kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    kept.finish()
    assert len(kept.samples.ids()) == 3
    assert (kept.count("kept"), kept.count("rate_limited"), kept.count("too_large")) == (3, 2, 1)


def test_samples_beyond_the_queue_are_dropped(tmp_path: Path):
    kept = Kept(tmp_path, per_minute=6000)
    for _ in range(MAX_WAITING + 5):  # nobody writes yet
        kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    assert kept.count("dropped") == 5
    kept.finish()
    assert kept.count("kept") == MAX_WAITING


def test_a_failing_store_loses_only_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    kept = Kept(tmp_path)

    def fails(self: Store, key: str, data: bytes) -> None:
        raise StoreUnavailable("gone")

    with monkeypatch.context() as broken:
        broken.setattr(Store, "put", fails)
        kept.sampler.start()
        kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
        wait_until(lambda: kept.count("failed") == 1)
    kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    kept.sampler.close()
    assert kept.count("kept") == 1


def sample_of(sample_id: str, **changes: Any) -> QuerySample:
    values: dict[str, Any] = {
        "sample_id": sample_id,
        "time": "2026-01-01T00:00:00+00:00",
        "transport": "http",
        "request_id": "r",
        "trace_id": "",
        "map_id": "hall",
        "media_type": XYZ,
        "content_encoding": "",
        "options": {},
        "answer": json.loads(REJECTED.json),
        "body_bytes": 1000,
    }
    return QuerySample(**{**values, **changes})


def aged(samples: QuerySamples, directory: Path, days: float, number: int) -> str:
    then = datetime.now(timezone.utc) - timedelta(days=days)
    sample_id = new_sample_id(f"{number:08x}", then)
    samples.put(sample_of(sample_id), bytes(1000))
    for path in (directory / "samples").glob(f"{sample_id}.*"):
        os.utime(path, (then.timestamp(), then.timestamp()))
    return sample_id


def test_old_samples_are_pruned(tmp_path: Path):
    kept = Kept(tmp_path, max_age_s=5 * 86400.0)
    old, young = aged(kept.samples, tmp_path, 6, 1), aged(kept.samples, tmp_path, 4, 2)
    assert kept.samples.ids() == [old, young]
    kept.finish()
    assert kept.samples.ids() == [young]
    with pytest.raises(NotFound):
        kept.samples.body(old)


def test_the_oldest_are_pruned_over_the_size_limit(tmp_path: Path):
    kept = Kept(tmp_path, max_bytes=3000, per_minute=6000)
    ids = [aged(kept.samples, tmp_path, 1 - number / 10, number) for number in range(4)]
    left = kept.samples.prune(older_than_s=1e9, max_bytes=3000)
    assert left <= 3000
    assert kept.samples.ids() == ids[-1:], "each is 1 kB of body and a record"


def test_the_limit_holds_while_samples_come(tmp_path: Path):
    kept = Kept(tmp_path, max_bytes=20_000, per_minute=6000)
    for _ in range(MAX_WAITING):
        kept.sampler.offer(QUERY, bytes(2000), REJECTED, None)
    kept.finish()
    size = sum(path.stat().st_size for path in (tmp_path / "samples").iterdir())
    assert size <= 20_000 + 4000, "the last one may be over"
    assert kept.samples.ids()


def test_an_incomplete_sample_is_pruned_and_not_listed(tmp_path: Path):
    samples = QuerySamples(Store.open(str(tmp_path)))
    sample_id = new_sample_id("0" * 8, datetime.now(timezone.utc) - timedelta(days=2))
    Store.open(str(tmp_path)).put(f"samples/{sample_id}.body", b"1234")
    then = time.time() - 2 * 86400
    os.utime(tmp_path / "samples" / f"{sample_id}.body", (then, then))
    assert samples.ids() == []
    assert samples.prune(older_than_s=86400, max_bytes=10**9) == 0
    assert list((tmp_path / "samples").iterdir()) == []


@pytest.mark.parametrize("sample_id", ["../secret", "x", "20260101t000000000000-0000000g", ""])
def test_invalid_id_is_rejected(tmp_path: Path, sample_id: str):
    samples = QuerySamples(Store.open(str(tmp_path)))
    for call in (samples.get, samples.body, samples.delete):
        with pytest.raises(InvalidOption, match="not a sample id"):
            call(sample_id)


# The command line


@pytest.fixture
def sample_id(service: Service) -> str:
    service.ask("http", body=gzip.compress(SCAN_BODY), content_encoding="gzip")
    wait_until(lambda: kept_by(service).ids())
    return kept_by(service).ids()[0]


def test_recorded_queries_are_listed_shown_fetched_and_removed(service, sample_id, tmp_path):
    where = ("--store", service.settings.store)
    line = firstfix("samples", "ls", *where).out
    assert all(word in line for word in (sample_id, "rejected", "low_inlier_ratio"))
    none = firstfix("samples", "ls", *where, "--map", "yard", "--json").out
    assert json.loads(none) == {"samples": []}
    assert json.loads(firstfix("samples", "show", sample_id, *where).out)["map_id"] == "hall"
    firstfix("samples", "fetch", *where, "-o", tmp_path / "out")
    assert (tmp_path / "out" / f"{sample_id}.body").read_bytes() == SCAN_BODY, "without its encoding"
    firstfix("samples", "rm", *where, code=2)
    firstfix("samples", "rm", sample_id, *where)
    assert kept_by(service).ids() == []
    firstfix("samples", "show", sample_id, *where, code=2)


def test_only_callers_that_may_read_recorded_queries_replay_without_a_trace(tmp_path: Path):
    with judging(tmp_path, zenoh=False, samples_share=1.0, **KEYED) as service:
        for key in (known(service, "build"), known(service, "localize")):
            headers = {"Content-Type": XYZ, **bearer(key), "X-Request-Id": "replay-me"}
            asked = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=headers)
            assert asked.is_success
        wait_until(lambda: kept_by(service).ids())
    kept = kept_by(service)
    assert [kept.get(one).request_id for one in kept.ids()] == ["replay-me"], "the robot's, and no other"
    assert [len(kept.get(one).robot) for one in kept.ids()] == [16], "it has a key of its own"
