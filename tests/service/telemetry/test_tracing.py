"""Spans of queries and requests, received by a real collector."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from firstfix.errors import StoreUnavailable
from tests.otlp_collector import Collector, SpanSeen, running_collector
from tests.service.service_world import XYZ, Behaviour, Service, free_port, publish, running_service
from tests.waiting import LIMIT_S, wait_until

TRACE, CALLER = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
TRACEPARENT = f"00-{TRACE}-{CALLER}-01"
STAGES = ["queue", "map", "decode", "search"]


@pytest.fixture
def collector(monkeypatch: pytest.MonkeyPatch) -> Iterator[Collector]:
    with running_collector() as running:
        monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", running.url)
        monkeypatch.setenv("OTEL_BSP_SCHEDULE_DELAY", "50")
        yield running


@pytest.fixture
def service(tmp_path: Path, collector: Collector) -> Iterator[Service]:
    with running_service(tmp_path) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        wait_until(lambda: running.http.get("/readyz").json().get("maps") == 1)
        yield running


def ask(service: Service, transport: str, traceparent: str | None = TRACEPARENT, **query: object) -> None:
    if transport == "zenoh":
        given = {} if traceparent is None else {"traceparent": traceparent}
        service.ask_zenoh(**{**query, "options": {**query.get("options", {}), **given}})  # type: ignore[arg-type,dict-item]
        return
    service.http.headers["traceparent"] = traceparent or ""
    service.ask_http(**query)  # type: ignore[arg-type]


def root(collector: Collector) -> SpanSeen:
    """The span of the only query."""
    wait_until(lambda: [*collector.named("POST /localize"), *collector.named("zenoh localize")])
    (found,) = [*collector.named("POST /localize"), *collector.named("zenoh localize")]
    return found


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_query_is_one_span_with_its_stages_below(service: Service, collector: Collector, transport: str):
    before = time.time_ns()
    ask(service, transport)
    span = root(collector)
    after = time.time_ns()
    assert (span.trace_id, span.parent_id) == (TRACE, CALLER)
    assert not span.is_error
    expected = {
        "firstfix.transport": transport,
        "firstfix.map_id": "hall",
        "firstfix.map_version": service.catalog.active_version("hall"),
        "firstfix.verdict": "localized",
        "firstfix.probability": 0.9,
        "firstfix.body_bytes": 1200,
        "firstfix.status": 200,
    }
    assert {name: span.attributes[name] for name in expected} == expected
    assert span.resource["service.name"] == "firstfix"
    assert span.resource["service.instance.id"] == "r1"

    wait_until(lambda: len(collector.below(span)) == 4)
    stages = collector.below(span)
    assert [stage.name for stage in stages] == STAGES
    assert {stage.trace_id for stage in stages} == {TRACE}
    for one, following in pairwise(stages):
        assert one.end_ns == following.start_ns
    assert (
        stages[-1].end_ns - stages[-1].start_ns == 1_500_000
    )  # the fake localizer reports a search of 1.5 ms
    assert before <= span.start_ns <= stages[0].start_ns <= span.end_ns <= after


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_what_goes_wrong_stands_in_the_span(service: Service, collector: Collector, transport: str):
    service.behaviour.raises = StoreUnavailable("gone")
    ask(service, transport)
    span = root(collector)
    assert span.is_error
    assert span.attributes["firstfix.code"] == "store_unavailable"
    assert span.attributes["firstfix.status"] == 503
    assert span.events == ["exception"]


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_callers_mistake_is_not_the_services_error(service: Service, collector: Collector, transport: str):
    ask(service, transport, options={"speed": "9"})
    span = root(collector)
    assert not span.is_error
    assert span.attributes["firstfix.code"] == "invalid_option"


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_bad_traceparent_begins_a_trace_of_its_own(service: Service, collector: Collector, transport: str):
    ask(service, transport, traceparent="00-zz-1-01")
    span = root(collector)
    assert span.parent_id == ""
    assert span.trace_id != TRACE


def test_a_trace_that_the_caller_does_not_keep_is_not_kept(service: Service, collector: Collector):
    ask(service, "http", traceparent=TRACEPARENT[:-1] + "0")
    ask(service, "http")
    wait_until(lambda: len(collector.below(root(collector))) == 4)
    assert len(collector.spans) == 5


def test_requests_have_spans_and_probes_have_none(service: Service, collector: Collector):
    service.http.get("/maps/attic")
    service.http.get("/healthz")
    service.http.get("/metrics")
    service.http.get("/maps")
    wait_until(lambda: collector.named("GET /maps"))
    assert {span.name for span in collector.spans} == {"GET /maps/{map_id}", "GET /maps"}
    (missing,) = collector.named("GET /maps/{map_id}")
    assert missing.attributes["http.response.status_code"] == 404
    assert missing.attributes["firstfix.code"] == "not_found"


def test_a_build_is_recorded_with_the_span_that_asked_for_it(service: Service, collector: Collector):
    answer = service.http.post(
        "/maps",
        data={"map_id": "hall"},
        files={"source": ("map.xyz", b"1 2 3")},
        headers={"traceparent": TRACEPARENT},
    )
    wait_until(lambda: collector.named("POST /maps"))
    (span,) = collector.named("POST /maps")
    request = service.catalog.builds.request(answer.json()["build_id"])
    assert request["traceparent"] == f"00-{TRACE}-{span.span_id}-01"


def test_measurements_name_a_trace_as_an_example(service: Service, collector: Collector):
    ask(service, "http")
    wanted = {"Accept": "application/openmetrics-text; version=1.0.0"}
    answer = service.http.get("/metrics", headers=wanted)
    assert answer.headers["content-type"].startswith("application/openmetrics-text")
    assert answer.text.endswith("# EOF\n")
    lines = [line for line in answer.text.splitlines() if f'# {{trace_id="{TRACE}"}}' in line]
    assert any(line.startswith("firstfix_localize_seconds_bucket{le=") for line in lines)
    assert any('stage="search"' in line for line in lines)
    plain = service.http.get("/metrics")
    assert plain.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    assert TRACE not in plain.text


def test_a_collector_that_is_away_keeps_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", f"http://127.0.0.1:{free_port()}")
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_TIMEOUT", "1")
    with running_service(tmp_path) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        for transport in ("http", "zenoh"):
            wait_until(lambda transport=transport: service.ask(transport).ok)


def test_without_a_collector_the_sdk_is_not_even_imported(tmp_path: Path):
    code = """
import asyncio, os, sys
os.environ.pop("OTEL_EXPORTER_OTLP_ENDPOINT", None)
from firstfix_service.app import create_app
from firstfix_service.settings import Settings

async def main(directory):
    app = create_app(Settings(store=f"{directory}/s", cache_dir=f"{directory}/c", work_dir=f"{directory}/w",
                              run_builds=False))
    async with app.router.lifespan_context(app):
        print("sdk:", [name for name in sys.modules if name.startswith("opentelemetry.sdk")])

asyncio.run(main(sys.argv[1]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=LIMIT_S
    )
    assert "sdk: []" in done.stdout, done.stderr


def test_the_endpoint_can_be_switched_off_as_opentelemetry_says(
    tmp_path: Path, collector: Collector, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("OTEL_SDK_DISABLED", "true")
    with running_service(tmp_path, zenoh=False, behaviour=Behaviour()) as service:
        service.http.post("/localize", content=b"", headers={"Content-Type": XYZ})
    assert collector.spans == []
