"""Samples of queries that were not localized: stored by the settings, listed and replayed."""

from __future__ import annotations

import gzip
import json
import os
import threading
import time
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.quality import AlignmentQuality
from firstfix.catalog.query_samples import QuerySample, QuerySamples, new_sample_id
from firstfix.engine.index import MapIndex
from firstfix.errors import InvalidOption, NotFound, StoreUnavailable
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix_cli.main import run
from firstfix_service.auth.principal import Principal
from firstfix_service.localize.sampler import MAX_WAITING, QuerySampler, SamplePolicy
from firstfix_service.query_workers.answer_form import AnswerForm
from firstfix_service.query_workers.encoded_answer import encoded_answer
from firstfix_service.query_workers.query import AsGiven, Query
from firstfix_service.telemetry.metrics import Metrics
from tests.service.access_world import give
from tests.service.service_world import SCAN_BODY, XYZ, FakeLocalizer, Service, publish, running_service
from tests.waiting import wait_until

LOCALIZED_POINTS = 200  # a scan of so many is localized, every other one rejected


def judged(
    self: FakeLocalizer, scan: Scan, options: LocalizeOptions | None = None, *_: object
) -> Localization:
    T = np.eye(4)
    T[0, 3] = self.label
    place = Hypothesis(T, AlignmentQuality(0.4, 0.3, 0.1), 0.4, 3)
    if len(scan) == LOCALIZED_POINTS:
        return Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.9, (place,))
    return Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,), probability=0.4, hypotheses=(place,))


@pytest.fixture(autouse=True)
def judging(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeLocalizer, "localize", judged)


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, samples_share=1.0) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        wait_until(lambda: running.http.get("/readyz").json().get("maps") == 1)
        yield running


def kept_by(service: Service) -> QuerySamples:
    return QuerySamples(service.catalog.store)


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_rejected_query_is_kept_as_it_came(service: Service, transport: str):
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


def test_a_localized_query_is_not_kept(service: Service):
    assert service.ask("http", body=bytes(12 * LOCALIZED_POINTS)).json["verdict"] == "localized"
    service.ask("http")  # kept after the other would have been
    wait_until(lambda: kept_by(service).ids())
    assert len(kept_by(service).ids()) == 1
    counted = 'firstfix_samples_total{result="kept"} 1.0'  # after it is in the store
    wait_until(lambda: counted in service.http.get("/metrics").text)


def test_nothing_is_kept_by_default(tmp_path: Path):
    before = set(threading.enumerate())  # other services may run in this process
    with running_service(tmp_path, zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        assert service.ask("http").json["verdict"] == "rejected"
        assert "query-sampler" not in {thread.name for thread in set(threading.enumerate()) - before}
    assert not (tmp_path / "store" / "samples").exists()


def test_another_place_can_be_named(tmp_path: Path):
    elsewhere = tmp_path / "elsewhere"
    with running_service(tmp_path, zenoh=False, samples_share=1.0, samples_store=str(elsewhere)) as service:
        publish(service.catalog, "hall", "1", service.scratch)
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


def test_a_share_is_kept(tmp_path: Path):
    kept = Kept(tmp_path, share=0.5, per_minute=6000)
    for _ in range(60):
        kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    kept.finish()
    assert 10 <= len(kept.samples.ids()) <= 50, "60 coins"


@pytest.mark.parametrize(("share", "count"), [(0.0, 0), (1.0, 1)])
def test_a_share_of_the_localized_ones(tmp_path: Path, share: float, count: int):
    kept = Kept(tmp_path, share=0.0, share_localized=share)
    kept.sampler.offer(QUERY, bytes(100), LOCALIZED, None)
    kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    kept.finish()
    assert len(kept.samples.ids()) == count


def test_so_many_a_minute_and_no_large_ones(tmp_path: Path):
    kept = Kept(tmp_path, per_minute=3)
    kept.sampler.offer(QUERY, bytes(2001), REJECTED, None)
    for _ in range(5):
        kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    kept.finish()
    assert len(kept.samples.ids()) == 3
    assert (kept.count("kept"), kept.count("rate_limited"), kept.count("too_large")) == (3, 2, 1)


def test_what_the_writer_cannot_keep_up_with_is_dropped(tmp_path: Path):
    kept = Kept(tmp_path, per_minute=6000)
    for _ in range(MAX_WAITING + 5):  # nobody writes yet
        kept.sampler.offer(QUERY, bytes(100), REJECTED, None)
    assert kept.count("dropped") == 5
    kept.finish()
    assert kept.count("kept") == MAX_WAITING


def test_a_store_that_fails_costs_the_samples_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
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


def test_old_samples_go(tmp_path: Path):
    kept = Kept(tmp_path, max_age_s=5 * 86400.0)
    old, young = aged(kept.samples, tmp_path, 6, 1), aged(kept.samples, tmp_path, 4, 2)
    assert kept.samples.ids() == [old, young]
    kept.finish()
    assert kept.samples.ids() == [young]
    with pytest.raises(NotFound):
        kept.samples.body(old)


def test_the_oldest_go_when_all_together_are_too_large(tmp_path: Path):
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


def test_half_a_sample_is_none_and_is_removed_in_time(tmp_path: Path):
    samples = QuerySamples(Store.open(str(tmp_path)))
    sample_id = new_sample_id("0" * 8, datetime.now(timezone.utc) - timedelta(days=2))
    Store.open(str(tmp_path)).put(f"samples/{sample_id}.body", b"1234")
    then = time.time() - 2 * 86400
    os.utime(tmp_path / "samples" / f"{sample_id}.body", (then, then))
    assert samples.ids() == []
    assert samples.prune(older_than_s=86400, max_bytes=10**9) == 0
    assert list((tmp_path / "samples").iterdir()) == []


@pytest.mark.parametrize("sample_id", ["../secret", "x", "20260101t000000000000-0000000g", ""])
def test_an_id_that_is_none(tmp_path: Path, sample_id: str):
    samples = QuerySamples(Store.open(str(tmp_path)))
    for call in (samples.get, samples.body, samples.delete):
        with pytest.raises(InvalidOption, match="not a sample id"):
            call(sample_id)


# The command line


def ended(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


@pytest.fixture
def sample_id(service: Service) -> str:
    service.ask("http", body=gzip.compress(SCAN_BODY), content_encoding="gzip")
    wait_until(lambda: kept_by(service).ids())
    return kept_by(service).ids()[0]


def test_kept_queries_are_listed_shown_fetched_and_removed(service, sample_id, tmp_path, capsys):
    where = ("--store", service.settings.store)
    assert ended("samples", "ls", *where) == 0
    line = capsys.readouterr().out
    assert sample_id in line
    assert "rejected" in line
    assert "low_inlier_ratio" in line
    assert ended("samples", "ls", *where, "--map", "yard", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"samples": []}
    assert ended("samples", "show", sample_id, *where) == 0
    assert json.loads(capsys.readouterr().out)["map_id"] == "hall"
    assert ended("samples", "fetch", *where, "-o", tmp_path / "out") == 0
    capsys.readouterr()
    assert (tmp_path / "out" / f"{sample_id}.body").read_bytes() == SCAN_BODY, "without its encoding"
    assert ended("samples", "rm", *where) == 2
    assert ended("samples", "rm", sample_id, *where) == 0
    assert kept_by(service).ids() == []
    assert ended("samples", "show", sample_id, *where) == 2


def test_kept_queries_are_asked_again(service, sample_id, tmp_path, capsys, monkeypatch):
    def better(
        self: FakeLocalizer, scan: Scan, options: LocalizeOptions | None = None, *_: object
    ) -> Localization:
        assert len(scan) == 100, "the same bytes"
        T = np.eye(4)
        T[:3, 3] = self.label + 3, 4, 0
        return Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.99)

    monkeypatch.setattr(FakeLocalizer, "localize", better)
    report = tmp_path / "report.json"
    asked = ("evaluate", "--samples", service.settings.store, "--map", "hall", "--url", service.url)
    assert ended(*asked, "--json", report) == 0
    out = capsys.readouterr().out
    assert "rejected -> localized: 1" in out
    assert "moved 5.00 m, 0.0 deg" in out
    found = json.loads(report.read_text())
    assert found["n"] == 1
    assert found["changes"] == [{"then": "rejected", "now": "localized", "n": 1}]
    (one,) = found["samples"]
    assert (one["sample"], one["moved_m"]) == (sample_id, 5.0)
    assert (one["then"]["probability"], one["now"]["probability"]) == (0.4, 0.99)
    assert one["now"]["map_version"] == service.catalog.active_version("hall")


def test_another_version_can_be_asked(service: Service, sample_id: str, capsys: pytest.CaptureFixture[str]):
    first = service.catalog.active_version("hall")
    publish(service.catalog, "hall", "2", service.scratch)
    asked = ("evaluate", "--samples", service.settings.store, "--map", "hall", "--url", service.url)
    assert ended(*asked, "--version", first) == 0
    assert "moved 0.00 m" in capsys.readouterr().out
    wait_until(lambda: service.ask("http").json["hypotheses"][0]["T_map_sensor"]["position"][0] == 2)
    assert ended(*asked) == 0
    assert "moved 1.00 m" in capsys.readouterr().out


def test_what_is_asked_again_is_not_kept_again(service: Service, sample_id: str):
    asked = ("evaluate", "--samples", service.settings.store, "--map", "hall", "--url", service.url)
    assert ended(*asked) == 0
    service.ask("http")  # kept after the other would have been
    wait_until(lambda: len(kept_by(service).ids()) > 1)
    assert len(kept_by(service).ids()) == 2


def test_only_who_may_read_kept_queries_asks_again_without_a_trace(tmp_path: Path):
    with running_service(tmp_path, zenoh=False, samples_share=1.0, auth="on", keys_refresh_s=0.1) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        robot, operator = give(service, "localize"), give(service, "build")

        def ask(key: str) -> bool:
            headers = {"Content-Type": XYZ, "Authorization": f"Bearer {key}", "X-Request-Id": "replay-me"}
            return service.http.post("/localize?map=hall", content=SCAN_BODY, headers=headers).is_success

        wait_until(lambda: ask(operator))
        assert ask(robot)
        wait_until(lambda: kept_by(service).ids())
    kept = kept_by(service)
    assert [kept.get(one).request_id for one in kept.ids()] == ["replay-me"], "the robot's, and no other"
    assert [len(kept.get(one).robot) for one in kept.ids()] == [16], "it has a key of its own"


def test_a_query_that_cannot_be_asked_again_says_why(service, sample_id, capsys):
    asked = ("evaluate", "--samples", service.settings.store, "--map", "hall", "--url", service.url)
    assert ended(*asked, "--version", "0" * 64) == 0
    assert "rejected -> error: 1" in capsys.readouterr().out
    assert ended(*asked[:3], "--map", "yard", "--url", service.url) == 0
    assert "0 kept queries sent again" in capsys.readouterr().out


def test_the_engine_in_this_process_can_be_asked(service, sample_id, monkeypatch, capsys):
    def load(directory: Path) -> float:
        return float((directory / "label.txt").read_text())

    monkeypatch.setattr(MapIndex, "load", load)
    monkeypatch.setattr(
        "firstfix.engine.localizer.Localizer", lambda label: FakeLocalizer(label, service.behaviour)
    )
    publish(service.catalog, "hall", "4", service.scratch)
    store = service.settings.store
    assert ended("evaluate", "--samples", store, "--map", "hall", "--store", store) == 0
    out = capsys.readouterr().out
    assert "rejected -> rejected: 1" in out
    assert "moved 3.00 m" in out


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("poses.csv", "--samples", "there"),
        ("--samples", "there", "--plot", "x.png"),
        ("--samples", "there", "--url", "http://127.0.0.1:1", "--store", "here"),
    ],
)
def test_what_does_not_go_together_is_refused(tmp_path: Path, arguments: tuple[str, ...], monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ended("evaluate", "--map", "hall", *arguments) == 2
