"""Logs: the same fields on both transports, a stream that holds nobody up, and no secrets."""

from __future__ import annotations

import json
import logging
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import structlog

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.catalog.catalog import Catalog
from firstfix.errors import StoreUnavailable
from firstfix.native import choice
from firstfix.store.store import Store
from firstfix_service.builds.process import last_message
from firstfix_service.settings import Settings
from firstfix_service.startup.settings_summary import settings_summary, without_secrets
from firstfix_service.telemetry import log_lines
from firstfix_service.telemetry.log_lines import MAX_BYTES, LogLines, LogStream
from firstfix_service.telemetry.log_setup import set_up_logging
from tests.service.json_log import JsonLog, json_log
from tests.service.service_world import SCAN_BODY, XYZ, Service, free_port, is_ready, running_service, served
from tests.waiting import LIMIT_S, wait_until

TRACE, CALLER = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
TRACEPARENT = f"00-{TRACE}-{CALLER}-01"


@pytest.fixture
def log() -> Iterator[JsonLog]:
    with json_log() as kept:
        yield kept


@pytest.fixture
def service(tmp_path: Path, log: JsonLog) -> Iterator[Service]:
    with served(tmp_path, poll_interval_s=0.1) as running:
        running.wait_until_loaded()
        yield running


def ask(service: Service, transport: str, request_id: str) -> None:
    if transport == "zenoh":
        service.ask_zenoh(options={"request_id": request_id, "traceparent": TRACEPARENT})
    else:
        service.http.headers.update({"X-Request-Id": request_id, "traceparent": TRACEPARENT})
        service.ask_http()


def line_of(log: JsonLog, request_id: str) -> dict[str, Any]:
    wait_until(lambda: log.of(event="request", request_id=request_id))
    (line,) = log.of(event="request", request_id=request_id)
    return line


def test_both_transports_log_the_same_fields(service: Service, log: JsonLog):
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
def test_every_line_of_a_request_has_its_ids(tmp_path: Path, log: JsonLog, transport: str):
    with served(tmp_path, poll_interval_s=60) as service:
        ask(service, transport, "cold")  # this query loads the version, in another thread
        line_of(log, "cold")
    (loaded,) = log.of(event="version loaded")
    assert loaded["request_id"] == "cold"
    assert loaded["trace_id"] == TRACE
    assert loaded["transport"] == transport


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_failure_is_logged_with_its_code(service: Service, log: JsonLog, transport: str):
    service.behaviour.raises = StoreUnavailable("gone")
    ask(service, transport, "failing")
    line = line_of(log, "failing")
    assert (line["status"], line["code"]) == (503, "store_unavailable")
    service.behaviour.raises = RuntimeError("odd")
    ask(service, transport, "odd")
    assert (line_of(log, "odd")["status"], line_of(log, "odd")["code"]) == (500, "internal")
    (trouble,) = log.of(event="unexpected error", request_id="odd")
    assert "RuntimeError: odd" in trouble["exception"]


def test_an_invalid_request_id_is_replaced(service: Service, log: JsonLog):
    service.ask_zenoh(options={"request_id": 'a"b'})
    wait_until(lambda: log.of(event="request", transport="zenoh"))
    (line,) = log.of(event="request", transport="zenoh")
    assert len(line["request_id"]) == 32


def test_the_first_line_shows_the_settings_without_secrets(service: Service, log: JsonLog):
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
def test_the_last_message_of_a_build_is_found(tmp_path: Path, text: str, message: str | None):
    log = tmp_path / "b.log"
    log.write_text(text)
    assert last_message(log) == message
    assert last_message(tmp_path / "none.log") is None


def test_a_log_that_cannot_be_written_is_no_error(tmp_path: Path):
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


@pytest.fixture
def pipe() -> tuple[int, int]:
    return os.pipe()


def read_all(descriptor: int) -> list[str]:
    """Until the other end is closed."""
    with open(descriptor, "rb") as file:
        return file.read().decode().splitlines()


def test_lines_are_written_complete_and_in_order(pipe: tuple[int, int]):
    stream = LogStream(pipe[1])
    threads = [
        threading.Thread(target=lambda k=k: [stream.write(f"{k} {n}\n") for n in range(200)])
        for k in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    stream.drain(LIMIT_S)
    os.close(pipe[1])
    lines = [line.split() for line in read_all(pipe[0])]
    for k in range(4):
        assert [int(n) for one, n in lines if one == str(k)] == list(range(200))


def test_a_stopped_reader_delays_no_writer(pipe: tuple[int, int]):
    stream = LogStream(pipe[1])
    line = "x" * 9_999 + "\n"
    for _ in range(2 * MAX_BYTES // len(line)):  # the pipe takes 64 kB
        stream.write(line)
    read: list[str] = []
    reading = threading.Thread(target=lambda: read.extend(read_all(pipe[0])))
    reading.start()
    stream.drain(LIMIT_S)
    os.close(pipe[1])
    reading.join()
    told = [one for one in read if one != line.rstrip()]
    assert len(told) == 1
    assert "log lines were lost" in told[0]
    kept = len(read) - 1
    assert MAX_BYTES // len(line) <= kept < 2 * MAX_BYTES // len(line)


def test_lines_that_wait_to_be_rendered_count_with_their_texts(pipe: tuple[int, int]):
    stream = LogStream(pipe[1])
    lines = LogLines("test", logging.StreamHandler(stream), json.dumps, logging.INFO)
    text = "x" * 99_999
    for _ in range(2 * MAX_BYTES // len(text)):
        lines.info(event=text)
        lines.write_made(lambda: {"event": text}, len(text))
    read: list[str] = []
    reading = threading.Thread(target=lambda: read.extend(read_all(pipe[0])))
    reading.start()
    stream.drain(LIMIT_S)
    os.close(pipe[1])
    reading.join()
    kept = sum(text in one for one in read)
    assert 0 < kept < 2 * MAX_BYTES // len(text)


def test_a_drain_ends_without_a_reader(pipe: tuple[int, int]):
    stream = LogStream(pipe[1])
    stream.write("x" * (1 << 20))
    stream.drain(0.1)
    reading = threading.Thread(target=read_all, args=(pipe[0],))
    reading.start()
    stream.drain(LIMIT_S)
    os.close(pipe[1])
    reading.join()


def test_a_closed_reader_is_no_error(pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch):
    tried: list[int] = []

    def fail(descriptor: int, data: memoryview) -> int:
        tried.append(len(data))
        raise BrokenPipeError

    monkeypatch.setattr(log_lines.os, "write", fail)
    stream = LogStream(pipe[1])
    stream.write("one\n")
    wait_until(lambda: len(tried) == 1)
    stream.write("two\n")
    wait_until(lambda: len(tried) == 2)
    stream.drain(LIMIT_S)
    monkeypatch.undo()
    for end in pipe:
        os.close(end)


SECRETS = {
    "AWS_SECRET_ACCESS_KEY": "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY",
    "AZURE_STORAGE_ACCOUNT_KEY": "azure-key-0123456789==",
    "MY_DATABASE_PASSWORD": 'tricky "quoted" pass',
}
HOOK_PATH = "/hooks/T0123/pathsecret"
WORDS = ("hunter2", "s1gn4ture", *SECRETS.values())


@pytest.mark.parametrize("as_json", [True, False], ids=["json", "console"])
def test_no_secret_is_logged_or_answered(tmp_path: Path, as_json: bool):
    store = tmp_path / "store"
    keys = ApiKeys(Store.open(str(store)))
    token = keys.create("robot", Grant.parse(["admin"], ["*"]))[1]
    wrong = "ffx_0123456789ab_" + "5e" * 32
    port, log = free_port(), tmp_path / "log"
    environment = {
        **os.environ,
        **SECRETS,
        "FIRSTFIX_AUTH": "on",
        "FIRSTFIX_LOG_LEVEL": "debug",
        "FIRSTFIX_LOG_JSON": json.dumps(as_json),
        "FIRSTFIX_JWT_JWKS": "https://issuer.invalid/keys?token=hunter2",
        "FIRSTFIX_JWT_ISSUER": "x",
        "FIRSTFIX_JWT_AUDIENCE": "y",
        "FIRSTFIX_SOURCE_URLS": '["https://files.example.org/"]',
        "FIRSTFIX_WEBHOOK_URLS": f'["https://fleet.invalid{HOOK_PATH}"]',
        "FIRSTFIX_WEBHOOK_SECRET_FILE": str(tmp_path / "webhook-secret"),
    }
    code = """
import sys
from firstfix_service.server import serve
from firstfix_service.settings import Settings
serve(Settings(store=sys.argv[1], port=int(sys.argv[2]), work_dir=sys.argv[1] + "-work"))
"""
    (tmp_path / "webhook-secret").write_text("whsec_" + "QUJD" * 10)
    bodies = []
    with log.open("wb") as file:
        command = [sys.executable, "-c", code, str(store), str(port)]
        process = subprocess.Popen(command, stdout=file, stderr=file, env=environment)
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=LIMIT_S) as http:
                wait_until(lambda: process.poll() is not None or is_ready(str(http.base_url)))
                good = {"Authorization": f"Bearer {token}"}
                asked = [
                    http.get("/maps", headers=good),
                    http.get("/maps", headers={"Authorization": f"Bearer {wrong}"}),
                    http.get("/maps", headers={"Authorization": "Basic aHVudGVyMjpodW50ZXIy"}),
                    http.get(
                        "/maps", headers={"Authorization": "Bearer eyJhbGciOiJFUzI1NiJ9.e30.aHVudGVyMg"}
                    ),
                    http.get(f"/maps?api_key={token}&password=hunter2"),
                    http.get(f"/maps/{token}", headers=good),
                    http.get(f"/{token}?sig=s1gn4ture"),
                    http.get("/maps", headers={"X-Request-Id": token}),
                    http.get(HOOK_PATH),
                    http.post(
                        f"/localize?map=hall&{token}=1&version={token}",
                        content=SCAN_BODY,
                        headers={**good, "Content-Type": XYZ},
                    ),
                    http.post("/localize?map=hall", content=b"", headers={**good, "Content-Type": token}),
                ]
                for url in (
                    "https://robot:hunter2@files.example.org/a.ply",
                    "https://other.example.org/a.ply?X-Amz-Signature=s1gn4ture",
                    "https://robot:hunter2@ not a url",
                    "s3://bucket/x?secret=hunter2",
                    "https://robot:hunter2@[bad/a.ply",
                ):
                    named = {"map_id": "hall", "source": {"url": url}}
                    asked.append(http.post("/maps", json=named, headers=good))
                bodies = [answer.text for answer in asked]
                assert [answer.status_code for answer in asked[:4]] == [200, 401, 401, 503]
                assert all(answer.status_code >= 400 for answer in asked[4:])
        finally:
            process.terminate()
            process.wait(LIMIT_S)
    text = log.read_text()
    assert "request" in text
    assert "refused a credential" in text
    assert HOOK_PATH not in text
    for where, found in (("the log", text), *(("an answer", body) for body in bodies)):
        for secret in (
            token.split("_")[2],
            wrong.split("_")[2],
            "aHVudGVyMg",
            "aHVudGVyMjpodW50ZXIy",
            *WORDS,
        ):
            assert secret not in found, where
    if as_json:
        assert all(json.loads(line)["event"] for line in text.splitlines())


@pytest.mark.parametrize("as_json", [True, False], ids=["json", "console"])
@pytest.mark.usefixtures("logging_as_before")
def test_tracebacks_and_other_loggers_are_redacted(capsys, monkeypatch, as_json):
    for name, value in SECRETS.items():
        monkeypatch.setenv(name, value)
    set_up_logging(Settings(store="memory://", log_level="debug", log_json=as_json))
    local_secret = SECRETS["MY_DATABASE_PASSWORD"]
    try:
        raise ValueError(f"https://robot:hunter2@host refused {local_secret}")
    except ValueError:
        structlog.get_logger("ours").exception("it broke", header="Bearer hunter2-hunter2")
    logging.getLogger("theirs").debug("send_request_headers %r", [(b"Authorization", b"Token hunter2")])
    logging.getLogger("theirs").info("%s", SECRETS["AWS_SECRET_ACCESS_KEY"])
    written = capsys.readouterr().err
    assert "it broke" in written
    assert "Traceback" in written
    assert "***" in written
    for word in WORDS:
        assert word not in written


@pytest.mark.usefixtures("logging_as_before")
def test_line_breaks_of_callers_are_escaped_in_the_console(capsys: pytest.CaptureFixture[str]):
    set_up_logging(Settings(store="memory://", log_json=False))
    structlog.get_logger("ours").info("request", path="/a\r\n2030-01-01 [info] all is well\x1b[2J\u2028")
    written = re.sub(r"\x1b\[\d+m", "", capsys.readouterr().err)
    assert written.count("\n") == 1
    assert r"\r\n2030" in written
    assert "\x1b" not in written
