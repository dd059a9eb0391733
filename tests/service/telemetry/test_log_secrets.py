"""Debug logs of a service that receives keys, passwords and tokens in every way: none is in the log."""

from __future__ import annotations

import json
import logging
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import structlog

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.store.store import Store
from firstfix_service.settings import Settings
from firstfix_service.telemetry.log_setup import set_up_logging
from tests.service.service_world import SCAN_BODY, XYZ, free_port
from tests.waiting import LIMIT_S, wait_until

SECRETS = {
    "AWS_SECRET_ACCESS_KEY": "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY",
    "AZURE_STORAGE_ACCOUNT_KEY": "azure-key-0123456789==",
    "MY_DATABASE_PASSWORD": 'tricky "quoted" pass',
}
HOOK_PATH = "/hooks/T0123/pathsecret"
WORDS = ("hunter2", "s1gn4ture", *SECRETS.values())


@pytest.mark.parametrize("as_json", [True, False], ids=["json", "console"])
def test_nothing_secret_is_written(tmp_path: Path, as_json: bool):
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
                wait_until(lambda: process.poll() is not None or is_up(http))
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


def is_up(http: httpx.Client) -> bool:
    try:
        return http.get("/healthz").is_success
    except httpx.TransportError:
        return False


@pytest.fixture
def console(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    root = logging.getLogger()
    before = root.handlers, root.level
    yield
    root.handlers, level = before
    root.setLevel(level)
    structlog.reset_defaults()


@pytest.mark.parametrize("as_json", [True, False], ids=["json", "console"])
def test_tracebacks_and_other_loggers_are_read_through(console, capsys, monkeypatch, as_json):
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


def test_a_stranger_starts_no_line_in_the_console(console: None, capsys: pytest.CaptureFixture[str]):
    set_up_logging(Settings(store="memory://", log_json=False))
    structlog.get_logger("ours").info("request", path="/a\r\n2030-01-01 [info] all is well\x1b[2J\u2028")
    written = re.sub(r"\x1b\[\d+m", "", capsys.readouterr().err)
    assert written.count("\n") == 1
    assert r"\r\n2030" in written
    assert "\x1b" not in written
