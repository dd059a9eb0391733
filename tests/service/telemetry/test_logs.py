"""Log as JSON lines: one per request, with the same fields on both transports, and no secrets."""

from __future__ import annotations

import io
import json
import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import structlog

from firstfix.errors import StoreUnavailable
from firstfix.native import choice
from firstfix_service.builds.process import last_message
from firstfix_service.settings import Settings
from firstfix_service.startup.settings_summary import settings_summary, without_secrets
from firstfix_service.telemetry.log_setup import set_up_logging
from tests.service.service_world import Service, publish, running_service
from tests.waiting import LIMIT_S, wait_until

TRACE, CALLER = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
TRACEPARENT = f"00-{TRACE}-{CALLER}-01"


class Log:
    """Reads log lines written as JSON."""

    def __init__(self) -> None:
        self.stream = io.StringIO()

    @property
    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.stream.getvalue().splitlines()]

    def of(self, **fields: Any) -> list[dict[str, Any]]:
        return [line for line in self.lines if fields.items() <= line.items()]


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> Iterator[Log]:
    """Sets up JSON logs like ``serve``, during the test."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    kept = Log()
    monkeypatch.setattr(sys, "stderr", kept.stream)
    set_up_logging(Settings(store="memory://"))
    monkeypatch.undo()
    # loggers that were used before keep their old format
    for module in [m for name, m in sys.modules.items() if name.startswith("firstfix_service.")]:
        if hasattr(module, "_log"):
            monkeypatch.setattr(module, "_log", structlog.get_logger(module.__name__))
    yield kept
    root.handlers, root.level = handlers, level
    structlog.reset_defaults()


@pytest.fixture
def service(tmp_path: Path, log: Log) -> Iterator[Service]:
    with running_service(tmp_path, poll_interval_s=0.1) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        wait_until(lambda: running.http.get("/readyz").json().get("maps") == 1)
        yield running


def ask(service: Service, transport: str, request_id: str) -> None:
    if transport == "zenoh":
        service.ask_zenoh(options={"request_id": request_id, "traceparent": TRACEPARENT})
    else:
        service.http.headers.update({"X-Request-Id": request_id, "traceparent": TRACEPARENT})
        service.ask_http()


def line_of(log: Log, request_id: str) -> dict[str, Any]:
    wait_until(lambda: log.of(event="request", request_id=request_id))
    (line,) = log.of(event="request", request_id=request_id)
    return line


def test_both_transports_log_the_same_fields(service: Service, log: Log):
    lines = {}
    for transport in ("http", "zenoh"):
        ask(service, transport, f"one-{transport}")
        lines[transport] = line_of(log, f"one-{transport}")
    http, zenoh = lines["http"], lines["zenoh"]
    assert set(http) == set(zenoh)
    assert (http["method"], http["path"]) == ("POST", "/localize")
    assert (zenoh["method"], zenoh["path"]) == ("GET", "firstfix/hall/localize")
    expected = {
        "status": 200,
        "verdict": "localized",
        "probability": 0.9,
        "map_id": "hall",
        "body_bytes": 1200,
        "trace_id": TRACE,
        "span_id": CALLER,
        "level": "info",
    }
    for transport, line in lines.items():
        assert {**expected, "transport": transport}.items() <= line.items()
        assert line["ms"] > 0


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_every_line_of_a_request_has_its_ids(tmp_path: Path, log: Log, transport: str):
    with running_service(tmp_path, poll_interval_s=60) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        ask(service, transport, "cold")  # this query loads the version, in another thread
        line_of(log, "cold")
    (loaded,) = log.of(event="version loaded")
    assert loaded["request_id"] == "cold"
    assert loaded["trace_id"] == TRACE
    assert loaded["transport"] == transport


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_failure_is_logged_with_its_code(service: Service, log: Log, transport: str):
    service.behaviour.raises = StoreUnavailable("gone")
    ask(service, transport, "failing")
    line = line_of(log, "failing")
    assert (line["status"], line["code"]) == (503, "store_unavailable")
    service.behaviour.raises = RuntimeError("odd")
    ask(service, transport, "odd")
    assert (line_of(log, "odd")["status"], line_of(log, "odd")["code"]) == (500, "internal")
    (trouble,) = log.of(event="unexpected error", request_id="odd")
    assert "RuntimeError: odd" in trouble["exception"]


def test_an_odd_request_id_is_replaced(service: Service, log: Log):
    service.ask_zenoh(options={"request_id": 'a"b'})
    wait_until(lambda: log.of(event="request", transport="zenoh"))
    (line,) = log.of(event="request", transport="zenoh")
    assert len(line["request_id"]) == 32


def test_the_first_line_shows_the_settings_without_secrets(service: Service, log: Log):
    (line,) = log.of(event="ready to take requests")
    assert line["settings"]["replica"] == "r1"
    assert line["settings"]["workers"] == 2
    assert line["tracing"] is False
    assert line["compiled_core"] in choice.runnable()
    assert set(line["settings"]) == set(Settings.model_fields)


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("s3://maps/a?region=eu&endpoint=http://h:1", "s3://maps/a?region=eu&endpoint=http://h:1"),
        ("https://me:pass@host/x", "https://host/x"),
        ("https://host/x?sig=abc&se=2030", "https://host/x?sig=***&se=***"),
        ("s3://maps?endpoint=https://me:pass@host", "s3://maps?endpoint=https://host"),
        ("file:///data/maps", "file:///data/maps"),
    ],
)
def test_urls_are_shown_without_secrets(url: str, shown: str):
    assert without_secrets(url) == shown


def test_secret_settings_are_hidden():
    class MoreSettings(Settings):
        proxy_password: str | None = None
        key_url: str = ""

    summary = settings_summary(
        MoreSettings(
            store="/data", proxy_password="hunter2", key_url="https://u:p@h", source_urls=("s3://a:b@c/",)
        )
    )
    assert summary["proxy_password"] == "***"
    assert summary["key_url"] == "https://h"
    assert summary["source_urls"] == ["s3://c/"]
    assert "hunter2" not in json.dumps(summary)


def test_a_worker_under_the_service_logs_json_with_the_builds_ids(tmp_path: Path):
    from firstfix.catalog.catalog import Catalog
    from firstfix.store.store import Store

    catalog = Catalog(Store.open(str(tmp_path / "store")))
    request = {"map_id": "hall", "source": {"sha256": "0" * 64}, "traceparent": TRACEPARENT}
    catalog.builds.put("b1", request)
    with running_service(
        tmp_path,
        zenoh=False,
        run_builds=True,
        build_command=(sys.executable, "-m", "firstfix_builder.worker"),
    ):
        wait_until(lambda: catalog.builds.status("b1")["state"] == "failed")
        log_path = tmp_path / "work" / "b1.log"
        lines = [json.loads(line) for line in log_path.read_text().splitlines()]
    failed = next(line for line in lines if line["event"] == "build b1 failed in fetch_source")
    assert (failed["build_id"], failed["stage"], failed["trace_id"]) == ("b1", "fetch_source", TRACE)
    assert failed["level"] == "error"
    assert "Traceback" in failed["exception"]
    assert [stage["stage"] for stage in catalog.builds.stages("b1")] == ["fetch_source"]


def test_a_worker_run_by_hand_logs_plain_lines(tmp_path: Path):
    command = [sys.executable, "-m", "firstfix_builder.worker", "--store", str(tmp_path / "store")]
    done = subprocess.run(
        [*command, "--build", "b1", "--work", str(tmp_path / "work")],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert done.returncode == 2
    assert "ERROR" in done.stderr
    assert "no build b1" in done.stderr
    assert not done.stderr.startswith("{")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a\nthe reason\n", "the reason"),
        ('{"event": "the reason", "level": "error"}\n', "the reason"),
        ('{"level": "error"}\n', '{"level": "error"}'),
        ("[1]\n", "[1]"),
        ("", None),
    ],
)
def test_the_last_message_of_a_build(tmp_path: Path, text: str, message: str | None):
    log = tmp_path / "b.log"
    log.write_text(text)
    assert last_message(log) == message
    assert last_message(tmp_path / "none.log") is None


def test_a_log_that_cannot_be_written_stops_no_request(tmp_path: Path):
    """The disk of the log is full, or its reader has gone."""
    code = """
import structlog, sys
from firstfix_service.settings import Settings
from firstfix_service.telemetry.log_setup import set_up_logging
set_up_logging(Settings(store="memory://"))
structlog.get_logger("hall").info("request", path="/localize")
print("goes on", flush=True)
"""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=full, text=True)
    assert done.stdout == "goes on\n"
