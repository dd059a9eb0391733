"""Queries are recorded as the settings say, listed and replayed."""

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
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery, new_query_id
from firstfix.errors import InvalidOption, NotFound, StoreUnavailable
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix_service.auth.principal import Principal
from firstfix_service.localize.query_recorder import MAX_WAITING, QueryRecorder, RecordingPolicy
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
    with judging(tmp_path, recorded_share=1.0) as running:
        running.wait_until_loaded()
        yield running


def recorded_by(service: Service) -> RecordedQueries:
    return RecordedQueries(service.catalog.store)


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_rejected_query_is_recorded_as_it_came(service: Service, transport: str):
    body = gzip.compress(SCAN_BODY)
    options = {"min_probability": "0.5"}
    reply = service.ask(transport, body=body, content_encoding="gzip", options=options)
    queries = recorded_by(service)
    wait_until(lambda: len(queries.ids()) == 1)
    recorded = queries.get(queries.ids()[0])
    assert queries.body(recorded.query_id) == body
    assert (recorded.media_type, recorded.content_encoding) == (XYZ, "gzip")
    assert (recorded.transport, recorded.map_id, recorded.options) == (transport, "hall", options)
    assert recorded.body_bytes == len(body)
    assert {**reply.json, "timings_ms": 0} == {**recorded.answer, "timings_ms": 0}
    assert len(recorded.request_id) == 32
    assert recorded.robot == "", "nobody can tell who asked"
    age = datetime.now(timezone.utc) - datetime.fromisoformat(recorded.time)
    assert timedelta(0) <= age < timedelta(minutes=1)


def test_a_localized_query_is_not_recorded(service: Service):
    assert service.ask("http", body=bytes(12 * LOCALIZED_POINTS)).json["verdict"] == "localized"
    service.ask("http")  # recorded after the other would have been
    wait_until(lambda: recorded_by(service).ids())
    assert len(recorded_by(service).ids()) == 1
    wait_until(lambda: service.value("firstfix_recorded_queries_total", result="recorded") == 1)


def test_nothing_is_recorded_by_default(tmp_path: Path):
    before = set(threading.enumerate())  # other services may run in this process
    with judging(tmp_path, zenoh=False) as service:
        assert service.ask("http").json["verdict"] == "rejected"
        assert "query-recorder" not in {thread.name for thread in set(threading.enumerate()) - before}
    assert not (tmp_path / "store" / "recorded-queries").exists()


def test_recorded_queries_may_have_a_store_of_their_own(tmp_path: Path):
    elsewhere = tmp_path / "elsewhere"
    with judging(tmp_path, zenoh=False, recorded_share=1.0, recorded_store=str(elsewhere)) as service:
        assert service.ask("http").ok
    assert len(list((elsewhere / "recorded-queries").glob("*.body"))) == 1, (
        "written before the service stopped"
    )
    assert not (tmp_path / "store" / "recorded-queries").exists()


# What is recorded, and what is not


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


QUERY = Query.read(AsGiven(("hall",), XYZ), Principal("robot"), lambda: (), 0.0)


class Recorded:
    """A recorder over a file store, with its counters."""

    def __init__(self, directory: Path, **changes: Any) -> None:
        self.recorded_queries = RecordedQueries(Store.open(str(directory)))
        self.metrics = Metrics()
        self.recorder = QueryRecorder(
            self.recorded_queries, RecordingPolicy(**{**POLICY, **changes}), self.metrics
        )

    def count(self, result: str) -> float:
        return (
            self.metrics.registry.get_sample_value("firstfix_recorded_queries_total", {"result": result})
            or 0.0
        )

    def finish(self) -> None:
        self.recorder.start()
        self.recorder.close()


def test_a_share_of_queries_is_recorded(tmp_path: Path):
    queries = Recorded(tmp_path, share=0.5, per_minute=6000)
    for _ in range(60):
        queries.recorder.offer(QUERY, bytes(100), REJECTED, None)
    queries.finish()
    assert 10 <= len(queries.recorded_queries.ids()) <= 50, "60 coins"


@pytest.mark.parametrize(("share", "count"), [(0.0, 0), (1.0, 1)])
def test_localized_queries_have_a_share_of_their_own(tmp_path: Path, share: float, count: int):
    queries = Recorded(tmp_path, share=0.0, share_localized=share)
    queries.recorder.offer(QUERY, bytes(100), LOCALIZED, None)
    queries.recorder.offer(QUERY, bytes(100), REJECTED, None)
    queries.finish()
    assert len(queries.recorded_queries.ids()) == count


def test_the_rate_and_the_size_are_limited(tmp_path: Path):
    queries = Recorded(tmp_path, per_minute=3)
    queries.recorder.offer(QUERY, bytes(2001), REJECTED, None)
    for _ in range(5):
        queries.recorder.offer(QUERY, bytes(100), REJECTED, None)
    queries.finish()
    assert len(queries.recorded_queries.ids()) == 3
    assert (queries.count("recorded"), queries.count("rate_limited"), queries.count("too_large")) == (3, 2, 1)


def test_queries_beyond_the_waiting_ones_are_dropped(tmp_path: Path):
    queries = Recorded(tmp_path, per_minute=6000)
    for _ in range(MAX_WAITING + 5):  # nobody writes yet
        queries.recorder.offer(QUERY, bytes(100), REJECTED, None)
    assert queries.count("dropped") == 5
    queries.finish()
    assert queries.count("recorded") == MAX_WAITING


def test_a_failing_store_loses_only_recorded_queries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    queries = Recorded(tmp_path)

    def fails(self: Store, key: str, data: bytes) -> None:
        raise StoreUnavailable("gone")

    with monkeypatch.context() as broken:
        broken.setattr(Store, "put", fails)
        queries.recorder.start()
        queries.recorder.offer(QUERY, bytes(100), REJECTED, None)
        wait_until(lambda: queries.count("failed") == 1)
    queries.recorder.offer(QUERY, bytes(100), REJECTED, None)
    queries.recorder.close()
    assert queries.count("recorded") == 1


def query_of(query_id: str, **changes: Any) -> RecordedQuery:
    values: dict[str, Any] = {
        "query_id": query_id,
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
    return RecordedQuery(**{**values, **changes})


def aged(recorded_queries: RecordedQueries, directory: Path, days: float, number: int) -> str:
    then = datetime.now(timezone.utc) - timedelta(days=days)
    query_id = new_query_id(f"{number:08x}", then)
    recorded_queries.put(query_of(query_id), bytes(1000))
    for path in (directory / "recorded-queries").glob(f"{query_id}.*"):
        os.utime(path, (then.timestamp(), then.timestamp()))
    return query_id


def test_old_queries_are_pruned(tmp_path: Path):
    queries = Recorded(tmp_path, max_age_s=5 * 86400.0)
    old, young = (
        aged(queries.recorded_queries, tmp_path, 6, 1),
        aged(queries.recorded_queries, tmp_path, 4, 2),
    )
    assert queries.recorded_queries.ids() == [old, young]
    queries.finish()
    assert queries.recorded_queries.ids() == [young]
    with pytest.raises(NotFound):
        queries.recorded_queries.body(old)


def test_the_oldest_are_pruned_over_the_size_limit(tmp_path: Path):
    queries = Recorded(tmp_path, max_bytes=3000, per_minute=6000)
    ids = [aged(queries.recorded_queries, tmp_path, 1 - number / 10, number) for number in range(4)]
    left = queries.recorded_queries.prune(older_than_s=1e9, max_bytes=3000)
    assert left <= 3000
    assert queries.recorded_queries.ids() == ids[-1:], "each is 1 kB of body and a record"


def test_the_limit_holds_while_queries_come(tmp_path: Path):
    queries = Recorded(tmp_path, max_bytes=20_000, per_minute=6000)
    for _ in range(MAX_WAITING):
        queries.recorder.offer(QUERY, bytes(2000), REJECTED, None)
    queries.finish()
    size = sum(path.stat().st_size for path in (tmp_path / "recorded-queries").iterdir())
    assert size <= 20_000 + 4000, "the last one may be over"
    assert queries.recorded_queries.ids()


def test_an_incomplete_query_is_pruned_and_not_listed(tmp_path: Path):
    recorded_queries = RecordedQueries(Store.open(str(tmp_path)))
    query_id = new_query_id("0" * 8, datetime.now(timezone.utc) - timedelta(days=2))
    Store.open(str(tmp_path)).put(f"recorded-queries/{query_id}.body", b"1234")
    then = time.time() - 2 * 86400
    os.utime(tmp_path / "recorded-queries" / f"{query_id}.body", (then, then))
    assert recorded_queries.ids() == []
    assert recorded_queries.prune(older_than_s=86400, max_bytes=10**9) == 0
    assert list((tmp_path / "recorded-queries").iterdir()) == []


@pytest.mark.parametrize("query_id", ["../secret", "x", "20260101t000000000000-0000000g", ""])
def test_invalid_id_is_rejected(tmp_path: Path, query_id: str):
    recorded_queries = RecordedQueries(Store.open(str(tmp_path)))
    for call in (recorded_queries.get, recorded_queries.body, recorded_queries.delete):
        with pytest.raises(InvalidOption, match="not the id of a recorded query"):
            call(query_id)


# The command line


@pytest.fixture
def query_id(service: Service) -> str:
    service.ask("http", body=gzip.compress(SCAN_BODY), content_encoding="gzip")
    wait_until(lambda: recorded_by(service).ids())
    return recorded_by(service).ids()[0]


def test_recorded_queries_are_listed_shown_fetched_and_removed(service, query_id, tmp_path):
    where = ("--store", service.settings.store)
    line = firstfix("recorded", "ls", *where).out
    assert all(word in line for word in (query_id, "rejected", "low_inlier_ratio"))
    none = firstfix("recorded", "ls", *where, "--map", "yard", "--json").out
    assert json.loads(none) == {"queries": []}
    assert json.loads(firstfix("recorded", "show", query_id, *where).out)["map_id"] == "hall"
    firstfix("recorded", "fetch", *where, "-o", tmp_path / "out")
    assert (tmp_path / "out" / f"{query_id}.body").read_bytes() == SCAN_BODY, "without its encoding"
    firstfix("recorded", "rm", *where, code=2)
    firstfix("recorded", "rm", query_id, *where)
    assert recorded_by(service).ids() == []
    firstfix("recorded", "show", query_id, *where, code=2)


def test_only_callers_that_may_read_recorded_queries_replay_without_a_trace(tmp_path: Path):
    with judging(tmp_path, zenoh=False, recorded_share=1.0, **KEYED) as service:
        for key in (known(service, "build"), known(service, "localize")):
            headers = {"Content-Type": XYZ, **bearer(key), "X-Request-Id": "replay-me"}
            asked = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=headers)
            assert asked.is_success
        wait_until(lambda: recorded_by(service).ids())
    queries = recorded_by(service)
    assert [queries.get(one).request_id for one in queries.ids()] == ["replay-me"], (
        "the robot's, and no other"
    )
    assert [len(queries.get(one).robot) for one in queries.ids()] == [16], "it has a key of its own"
