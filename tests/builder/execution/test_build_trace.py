"""Stages of builds as a real collector gets them, and as the build's record keeps them."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from itertools import pairwise
from pathlib import Path

import pytest

from firstfix.builds.options import BuildOptions
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.errors import BuildFailed, StoreUnavailable
from firstfix.store.store import Store
from firstfix_builder.execution.build_trace import (
    BuildTrace,
    current_build,
    mark_cached,
    set_up_build_log,
    within_a_stage,
)
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.job import fetch_http
from firstfix_builder.job.build_job import BuildJob, BuildResult
from firstfix_builder.job.run_build import run_build
from tests.builder.fixtures import queue_build
from tests.otlp_collector import Collector, running_collector
from tests.waiting import LIMIT_S, wait_until

TRACE, CALLER = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
TRACEPARENT = f"00-{TRACE}-{CALLER}-01"
ALL = ["fetch_source", "one", "two", "publish"]


@pytest.fixture
def collector(monkeypatch: pytest.MonkeyPatch) -> Iterator[Collector]:
    with running_collector() as running:
        monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", running.url)
        yield running


class CachedPipeline:
    """Stages "one" and "two" by a real stage cache; ``error`` is raised in the second."""

    def __init__(self, error: Exception | None = None) -> None:
        self.error = error

    def __call__(self, job: BuildJob) -> BuildResult:
        cache = StageCache(job.work, code_version="1")

        def one(out: Path) -> None:
            (out / "a.bin").write_bytes(job.source.read_bytes())

        def two(out: Path) -> None:
            if self.error is not None:
                raise self.error
            (out / "b.bin").write_bytes(b"b")

        job.progress("one", 0.0)
        cache.run("one", {}, {}, one)
        job.progress("one", 1.0)
        job.progress("two", 0.0)
        directory = cache.run("two", {}, {}, two).directory
        return BuildResult(directory, Manifest.for_directory(directory))


@pytest.fixture
def catalog(tmp_path: Path) -> Catalog:
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    for build_id in ("b1", "b2"):
        queue_build(catalog, tmp_path, build_id, traceparent=TRACEPARENT)
    return catalog


def build(tmp_path: Path, build_id: str = "b1", error: Exception | None = None) -> int:
    options = BuildOptions(store=str(tmp_path / "store"), build_id=build_id, work=tmp_path / "work")
    return run_build(options, CachedPipeline(error), ("one", "two"))


def test_a_build_is_a_span_with_its_stages_below(catalog: Catalog, collector: Collector, tmp_path: Path):
    assert build(tmp_path) == 0
    (root,) = collector.named("build")
    assert (root.trace_id, root.parent_id) == (TRACE, CALLER)
    assert root.attributes == {
        "firstfix.build_id": "b1",
        "firstfix.map_id": "hall",
        "firstfix.state": "succeeded",
    }
    assert root.resource["service.name"] == "firstfix-builder"
    assert not root.is_error
    stages = collector.below(root)
    assert [stage.name for stage in stages] == ALL
    assert [stage.attributes["firstfix.cached"] for stage in stages] == [False] * 4
    for before, after in pairwise(stages):
        assert before.end_ns == after.start_ns
    assert root.start_ns == stages[0].start_ns
    assert stages[-1].end_ns <= root.end_ns


def test_stages_that_an_earlier_build_had_done_are_marked(
    catalog: Catalog, collector: Collector, tmp_path: Path
):
    build(tmp_path, "b1")
    build(tmp_path, "b2")
    again = next(span for span in collector.named("build") if span.attributes["firstfix.build_id"] == "b2")
    cached = {stage.name: stage.attributes["firstfix.cached"] for stage in collector.below(again)}
    assert cached == {"fetch_source": False, "one": True, "two": True, "publish": False}


def test_a_failed_stage_is_a_span_with_its_error(catalog: Catalog, collector: Collector, tmp_path: Path):
    assert build(tmp_path, error=BuildFailed("no floor")) == 1
    (root,) = collector.named("build")
    assert root.is_error
    assert (root.attributes["firstfix.state"], root.attributes["firstfix.code"]) == ("failed", "build_failed")
    assert [(stage.name, stage.is_error) for stage in collector.below(root)] == [
        ("fetch_source", False),
        ("one", False),
        ("two", True),
    ]


def test_a_build_that_is_to_be_run_again_is_interrupted(
    catalog: Catalog, collector: Collector, tmp_path: Path
):
    with pytest.raises(StoreUnavailable):
        build(tmp_path, error=StoreUnavailable("gone"))
    (root,) = collector.named("build")
    assert (root.attributes["firstfix.state"], root.attributes["firstfix.code"]) == (
        "interrupted",
        "store_unavailable",
    )


def test_a_build_that_had_ended_has_no_span(catalog: Catalog, collector: Collector, tmp_path: Path):
    build(tmp_path)
    build(tmp_path)
    assert len(collector.named("build")) == 1


def test_the_record_has_the_times_without_a_collector(catalog: Catalog, tmp_path: Path):
    assert catalog.builds.stages("b1") == []
    build(tmp_path, "b1")
    build(tmp_path, "b2")
    stages = catalog.builds.stages("b2")
    assert [stage["stage"] for stage in stages] == ALL
    assert [stage["cached"] for stage in stages] == [False, True, True, False]
    assert all(0 <= stage["seconds"] < 10 * LIMIT_S for stage in stages)


def test_stages_are_on_record_while_the_build_goes_on(catalog: Catalog, tmp_path: Path):
    catalog.builds.set_stages("b1", [{"stage": "of an attempt before", "seconds": 1.0, "cached": False}])
    seen: list[str] = []

    def look(job: BuildJob) -> BuildResult:
        job.progress("one", 0.0)
        job.progress("two", 0.0)
        wait_until(lambda: catalog.builds.details("b1")["stage"] == "two")
        seen.extend(stage["stage"] for stage in catalog.builds.details("b1")["stages"])
        raise BuildFailed("seen enough")

    options = BuildOptions(store=str(tmp_path / "store"), build_id="b1", work=tmp_path / "work")
    run_build(options, look, ("one", "two"))
    assert seen == ["fetch_source", "one"]


def test_a_wall_clock_that_is_set_back_shortens_no_stage(monkeypatch: pytest.MonkeyPatch):
    now_ns = time.time_ns()
    trace = BuildTrace("build", "hall", None, {})
    trace.tick("one")
    monkeypatch.setattr(time, "time_ns", lambda: now_ns - 3_600_000_000_000)
    trace.end("succeeded")
    (one,) = trace.stages
    assert one.seconds >= 0.0


def test_a_stage_that_the_build_takes_once_more_from_the_cache_is_not_reused():
    trace = BuildTrace("b1", "hall", None, environ={})
    trace.tick("one")
    trace.settle()
    trace.mark_cached("one")
    trace.tick("two")
    trace.mark_cached("two")
    trace.settle()
    trace.end("succeeded")
    assert [(stage.stage, stage.cached) for stage in trace.stages] == [("one", False), ("two", True)]


def test_late_ticks_change_nothing():
    trace = BuildTrace("b1", "hall", None, environ={})
    with trace:
        assert current_build() is trace
        trace.tick("one")
        trace.tick("one")
        mark_cached("one")
        trace.tick("two")
        trace.end("succeeded")
        trace.tick("three")
        trace.end("failed")
    assert [(stage.stage, stage.cached) for stage in trace.stages] == [("one", True), ("two", False)]
    assert current_build() is None
    mark_cached("one")  # nobody listens


def test_a_cached_stage_within_another_is_not_the_builds_own():
    with BuildTrace("b1", "hall", None, environ={}) as trace:
        trace.tick("one")
        with within_a_stage():
            mark_cached("one")
            mark_cached("two")
        trace.tick("two")
        trace.end("succeeded")
    assert [stage.cached for stage in trace.stages] == [False, False]


class Refusing(BaseHTTPRequestHandler):
    """It has no method: every request is answered with 501."""

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def refusing_server() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), Refusing) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


@pytest.mark.parametrize("as_json", [True, False], ids=["json", "text"])
def test_the_log_has_no_secret(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, as_json: bool
):
    """The log of a failed build is kept, and its last line may be the build's error."""
    monkeypatch.setattr(fetch_http, "PAUSE_S", 0.0)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "wJalrXUtnFEMI")
    root = logging.getLogger()
    before, level = root.handlers[:], root.level
    try:
        set_up_build_log(BuildOptions(build_id="b1", log_json=as_json, log_level="debug"))
        with refusing_server() as url, pytest.raises(BuildFailed, match="answered 501"):
            fetch_http.fetch_http(f"{url}/pathsecret/map.pcd", tmp_path / "map.pcd", 1000)
        try:
            raise BuildFailed("it refused wJalrXUtnFEMI and token=hunter2")
        except BuildFailed:
            logging.getLogger("somewhere").exception("failed")
    finally:
        root.handlers = before
        root.setLevel(level)
    written = capsys.readouterr().err
    assert "it refused *** and token=***" in written
    assert "pathsecret" not in written


def test_lines_of_the_log_tell_build_and_stage(capsys: pytest.CaptureFixture[str]):
    root = logging.getLogger()
    before, level = root.handlers[:], root.level
    try:
        set_up_build_log(BuildOptions(build_id="b1", log_json=True))
        log = logging.getLogger("somewhere")
        log.warning("before")
        with BuildTrace("b1", "hall", TRACEPARENT, environ={}) as trace:
            trace.tick("one")
            log.info("half of %d", 4)
            try:
                raise BuildFailed("no floor")
            except BuildFailed:
                log.exception("failed")
    finally:
        root.handlers = before
        root.setLevel(level)
    first, second, third = (json.loads(line) for line in capsys.readouterr().err.splitlines())
    assert (first["event"], first["build_id"]) == ("before", "b1")
    assert "stage" not in first
    del second["timestamp"]
    assert second == {
        "event": "half of 4",
        "level": "info",
        "logger": "somewhere",
        "build_id": "b1",
        "stage": "one",
        "trace_id": TRACE,
        "span_id": CALLER,
    }
    assert "BuildFailed: no floor" in third["exception"]
