"""Webhooks with real receivers, which work, fail, are slow or redirect; their log; and a whole service."""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import generate_latest
from pydantic import ValidationError

from firstfix.answer.localization import Verdict
from firstfix.errors import InvalidOption
from firstfix_service.query_workers.query import EncodedAnswer
from firstfix_service.settings import Settings
from firstfix_service.startup.settings_summary import settings_summary
from firstfix_service.telemetry.log_setup import set_up_logging
from firstfix_service.telemetry.metrics import Metrics
from firstfix_service.webhooks import sender as sender_module
from firstfix_service.webhooks.event import AnswerEvent, signed_headers
from firstfix_service.webhooks.sender import WebhookPolicy, WebhookSender
from tests.claimed import free_port
from tests.service.json_log import renew_loggers
from tests.service.service_world import SCAN_BODY, XYZ, publish, running_service
from tests.service.webhook_receiver import Receiver
from tests.waiting import LIMIT_S, let_pass, wait_until

SECRETS = (bytes(range(32)), bytes(range(100, 124)))


@pytest.fixture
def metrics() -> Metrics:
    return Metrics()


@pytest.fixture
def sender(receiver: Receiver, metrics: Metrics, monkeypatch: pytest.MonkeyPatch) -> Iterator[WebhookSender]:
    monkeypatch.setattr(sender_module, "FIRST_WAIT_S", 0.02)
    monkeypatch.setattr(sender_module, "STOP_WITHIN_S", 0.2)
    one = WebhookSender(WebhookPolicy((receiver.url,), SECRETS, frozenset({"localized"})), metrics)
    one.start()
    yield one
    one.close()


def event(verdict: Verdict = Verdict.LOCALIZED, **more: Any) -> AnswerEvent:
    answer = EncodedAnswer(verdict, (), 0.9, "hall", "ab" * 32, json=b'{"probability": 0.9}')
    return AnswerEvent(answer, "/replicas/r1", "robot7", "http", 0.1234567, "request1", **more)


def counts(metrics: Metrics) -> dict[str, float]:
    lines = generate_latest(metrics.registry).decode().splitlines()
    found = (
        line.partition('result="')[2].partition('"} ') for line in lines if "webhook_events_total" in line
    )
    return {result: float(count) for result, _, count in found if result}


def test_an_event_is_cloudevents_and_signed_by_each_secret(sender: WebhookSender, receiver: Receiver):
    sender.offer(event())
    sender.offer(event(Verdict.REJECTED))
    wait_until(lambda: receiver.got)
    path, headers, body = receiver.got[0]
    assert path == "/fixes"
    assert headers["content-type"] == "application/cloudevents+json; charset=utf-8"
    told = json.loads(body)
    assert told == {
        "specversion": "1.0",
        "id": headers["webhook-id"],
        "source": "/replicas/r1",
        "type": "firstfix.localization.localized",
        "subject": "hall",
        "time": told["time"],
        "datacontenttype": "application/json",
        "data": {
            "request_id": "request1",
            "caller": "robot7",
            "transport": "http",
            "seconds": 0.1235,
            "answer": {"probability": 0.9},
        },
    }
    assert abs(time.time() - int(headers["webhook-timestamp"])) < LIMIT_S
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    wanted = [base64.b64encode(hmac.new(one, signed, hashlib.sha256).digest()).decode() for one in SECRETS]
    assert headers["webhook-signature"].split(" ") == [f"v1,{one}" for one in wanted]
    let_pass(0.2)
    assert len(receiver.got) == 1, "a verdict that is not wanted"


def test_the_signature_follows_standard_webhooks():
    """The example of the standard's reference implementations."""
    secret = base64.b64decode("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw")
    headers = signed_headers("msg_p5jXN8AQM9LWM0D4loKWxJek", b'{"test": 2432232314}', [secret], 1614265330)
    assert headers["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def test_a_failing_receiver_gets_the_same_event_again(sender, receiver, metrics):
    receiver.statuses = [500, 404, 429]
    sender.offer(event())
    wait_until(lambda: counts(metrics).get("sent") == 1)
    assert len(receiver.got) == 4
    assert len({headers["webhook-id"] for _, headers, _ in receiver.got}) == 1
    assert len({body for _, _, body in receiver.got}) == 1


@pytest.mark.parametrize("status", [302, 307, 308, 410])
def test_redirects_and_410_end_the_attempts(sender, receiver, metrics, status):
    receiver.statuses = [status]
    sender.offer(event())
    wait_until(lambda: counts(metrics).get("failed") == 1)
    assert [path for path, _, _ in receiver.got] == ["/fixes"]


def test_attempts_are_bounded(sender, receiver, metrics, monkeypatch):
    monkeypatch.setattr(sender_module, "MAX_ATTEMPTS", 3)
    receiver.statuses = [500] * 10
    sender.offer(event())
    wait_until(lambda: counts(metrics).get("failed") == 1)
    assert len(receiver.got) == 3


def test_events_beyond_the_queue_are_dropped(receiver, sender, metrics, monkeypatch):
    monkeypatch.setattr(sender_module, "MAX_WAITING", 20)
    receiver.gate.clear()
    for _ in range(50):  # returns at once, however slow the receiver is
        sender.offer(event())
    assert counts(metrics) == {"dropped": 30}
    wait_until(lambda: len(receiver.got) == sender_module.AT_ONCE)
    receiver.gate.set()
    wait_until(lambda: counts(metrics).get("sent") == 20)
    sender.offer(event())
    wait_until(lambda: counts(metrics).get("sent") == 21)


def test_a_hanging_receiver_is_given_up_and_does_not_hold_up_the_stop(receiver, sender, metrics, monkeypatch):
    monkeypatch.setattr(sender_module, "TIMEOUT_S", 0.3)
    receiver.gate.clear()
    sender.offer(event())
    wait_until(lambda: len(receiver.got) > 1)  # it was tried again
    monkeypatch.setattr(sender_module, "TIMEOUT_S", LIMIT_S)
    wait_until(lambda: len(receiver.got) > 2)
    sender.close()
    assert counts(metrics) == {"dropped": 1}
    sender.offer(event())
    assert counts(metrics) == {"dropped": 2}


def write_secret(folder: Path, text: str | None = None) -> Path:
    file = folder / "secret"
    file.write_text(text or f"whsec_{base64.b64encode(SECRETS[0]).decode()}\n")
    return file


@pytest.mark.parametrize(
    ("url", "secret", "says"),
    [
        ("ftp://host/x-private", None, "URL number 1"),
        ("https:///x-private", None, "URL number 1"),
        ("https://user:x-private@host/", None, "URL number 1"),
        ("https://host:port/x-private", None, "URL number 1"),
        ("https://host/", "too short", "one secret a line"),
        ("https://host/", "whsec_c2hvcnQ=", "one secret a line"),
        ("https://host/", "", "FIRSTFIX_WEBHOOK_SECRET_FILE"),
        ("https://host/", "missing", "No such file"),
    ],
)
def test_invalid_settings_are_refused_without_a_secret_in_the_message(tmp_path, url, secret, says):
    file: Path | None = write_secret(tmp_path, secret or None)
    if secret == "missing":
        file = tmp_path / "none"
    elif secret == "":
        file = None
    settings = Settings(store="memory://", webhook_urls=(url,), webhook_secret_file=file)
    with pytest.raises(InvalidOption, match=says) as caught:
        WebhookPolicy.of(settings)
    assert "x-private" not in str(caught.value)
    assert "x-private" not in json.dumps(settings_summary(settings))


def test_the_policy_comes_from_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert WebhookPolicy.of(Settings(store="memory://")) is None
    monkeypatch.setenv("FIRSTFIX_WEBHOOK_URLS", '["https://host/a", "http://host/b"]')
    monkeypatch.setenv("FIRSTFIX_WEBHOOK_SECRET_FILE", str(write_secret(tmp_path)))
    monkeypatch.setenv("FIRSTFIX_WEBHOOK_VERDICTS", '["localized", "ambiguous"]')
    policy = WebhookPolicy.of(Settings(store="memory://"))
    assert policy == WebhookPolicy(
        ("https://host/a", "http://host/b"), SECRETS[:1], frozenset({"localized", "ambiguous"})
    )
    monkeypatch.setenv("FIRSTFIX_WEBHOOK_VERDICTS", '["fine"]')
    with pytest.raises(ValidationError):
        Settings(store="memory://")


def test_a_service_sends_each_fix_of_both_transports(tmp_path: Path, receiver: Receiver):
    receiver.gate.clear()  # it does not answer before the queries are answered
    with running_service(
        tmp_path, webhook_urls=(receiver.url,), webhook_secret_file=write_secret(tmp_path)
    ) as service:
        publish(service.catalog, "hall", "1.0", service.scratch)
        wait_until(lambda: service.ask_http().ok)
        wait_until(lambda: receiver.got)
        replies = [service.ask_http(), service.ask_zenoh()]
        replay = {"content-type": XYZ, "x-request-id": "replay-1"}
        service.http.post("/localize", params={"map": "hall"}, content=SCAN_BODY, headers=replay)
        receiver.gate.set()
        wait_until(lambda: len(receiver.got) == 3)
        shown = service.http.get("/metrics").text
    told = [json.loads(body) for _, _, body in receiver.got[1:]]
    assert {one["data"]["transport"] for one in told} == {"http", "zenoh"}
    assert {one["source"] for one in told} == {"/replicas/r1"}
    answers = {one["data"]["transport"]: one["data"]["answer"] for one in told}
    assert answers == {"http": replies[0].json, "zenoh": replies[1].json}
    assert "firstfix_webhook_waiting" in shown


SECRET = "pathsecret"
COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def send_one(url: str, level: str, as_json: bool, result: str) -> None:
    """Sends one event with the log of ``serve``, until it has the result."""
    settings = Settings(store="memory://", log_level=level, log_json=as_json, webhook_urls=(url,))
    set_up_logging(settings)
    renew_loggers()
    metrics = Metrics()
    policy = WebhookPolicy((url,), (bytes(32),), frozenset({"localized"}))
    sender = WebhookSender(policy, metrics)
    sender.start()
    try:
        answer = EncodedAnswer(Verdict.LOCALIZED, (), 0.9, "hall", "ab" * 32, json=b"{}")
        sender.offer(AnswerEvent(answer, "/replicas/r1", "robot7", "http", 0.1, "request1"))
        wanted = f'firstfix_webhook_events_total{{result="{result}"}} 1.0'
        wait_until(lambda: wanted in generate_latest(metrics.registry).decode())
    finally:
        sender.close()


@pytest.fixture
def few_attempts(monkeypatch) -> None:
    monkeypatch.setattr(sender_module, "FIRST_WAIT_S", 0.02)
    monkeypatch.setattr(sender_module, "MAX_ATTEMPTS", 2)


def check_log(written: str, problem: str) -> None:
    """The log tells of the problem, if there is one, and nothing of the URL but its host."""
    written = COLOUR.sub("", written)
    assert SECRET not in written
    assert "s1gn4ture" not in written
    assert "httpx" not in written
    assert "httpcore" not in written
    assert (f"problem={problem}" in written or f'"problem": "{problem}"' in written) == bool(problem), written
    assert ("127.0.0.1" in written) == bool(problem)


PARTS = f"/hooks/{SECRET}?sig=s1gn4ture&x=1"
CASES = {  # result and problem
    "204": ("sent", ""),
    "307": ("failed", "redirect"),
    "410": ("failed", "gone"),
    "503": ("failed", "status 503"),
    "404": ("failed", "status 404"),
    "timeout": ("failed", "timeout"),
    "refused": ("failed", "ConnectError"),
    "defect": ("failed", ""),
}


@pytest.mark.slow
@pytest.mark.parametrize("level", ["info", "debug"])
@pytest.mark.parametrize("as_json", [True, False], ids=["json", "console"])
@pytest.mark.parametrize("case", CASES)
@pytest.mark.usefixtures("logging_as_before", "few_attempts")
def test_the_log_names_the_problem_and_of_the_url_its_host_alone(
    receiver, capsys, monkeypatch, level, as_json, case
):
    """Also where a traceback has what the error says, which may be the URL."""
    result, problem = CASES[case]
    url = f"{receiver.origin}{PARTS}"
    if case.isdigit():
        receiver.statuses = [int(case)] * 2
    elif case == "timeout":
        monkeypatch.setattr(sender_module, "TIMEOUT_S", 0.2)
        receiver.gate.clear()
    elif case == "refused":
        url = f"http://127.0.0.1:{free_port()}{PARTS}"
    else:

        def fail(*_: object) -> dict[str, str]:
            raise RuntimeError(f"cannot post to {url}")

        monkeypatch.setattr(sender_module, "signed_headers", fail)
    send_one(url, level, as_json, result)
    written = capsys.readouterr().err
    if case.isdigit():
        assert receiver.got[0][0] == PARTS
    if case == "defect":
        assert "cannot post to http://127.0.0.1" in written
        written = written.replace("127.0.0.1", "")
    check_log(written, problem if as_json or " " not in problem else f"'{problem}'")
