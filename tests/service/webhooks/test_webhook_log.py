"""The log of webhooks: whatever comes of an attempt, it has neither the path nor the query of the URL."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator

import pytest
import structlog
from prometheus_client import generate_latest

from firstfix.answer.localization import Verdict
from firstfix_service.query_workers.query import EncodedAnswer
from firstfix_service.settings import Settings
from firstfix_service.telemetry.log_setup import set_up_logging
from firstfix_service.telemetry.metrics import Metrics
from firstfix_service.webhooks import sender as sender_module
from firstfix_service.webhooks.event import AnswerEvent
from firstfix_service.webhooks.sender import WebhookPolicy, WebhookSender
from tests.claimed import free_port
from tests.service.webhook_receiver import Receiver
from tests.waiting import wait_until

pytestmark = pytest.mark.slow
SECRET = "pathsecret"
COLOUR = re.compile(r"\x1b\[[0-9;]*m")


@pytest.fixture
def log_state() -> Iterator[None]:
    root = logging.getLogger()
    names = ("httpx", "httpcore")
    before, levels = root.handlers[:], {name: logging.getLogger(name).level for name in (None, *names)}
    yield
    root.handlers = before
    for name, level in levels.items():
        logging.getLogger(name).setLevel(level)
    structlog.reset_defaults()


def sent(url: str, level: str, as_json: bool, result: str) -> None:
    """Sends one event with the log of ``serve``, until it has the result."""
    settings = Settings(store="memory://", log_level=level, log_json=as_json, webhook_urls=(url,))
    set_up_logging(settings)
    sender_module._log = structlog.get_logger(sender_module.__name__)
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
def receiver(monkeypatch: pytest.MonkeyPatch) -> Iterator[Receiver]:
    monkeypatch.setattr(sender_module, "FIRST_WAIT_S", 0.02)
    monkeypatch.setattr(sender_module, "MAX_ATTEMPTS", 2)
    one = Receiver()
    yield one
    one.close()


def check(written: str, problem: str) -> None:
    """The log tells of the problem, if there is one, and nothing of the URL but its host."""
    written = COLOUR.sub("", written)
    assert SECRET not in written
    assert "s1gn4ture" not in written
    assert "httpx" not in written
    assert "httpcore" not in written
    assert (f"problem={problem}" in written or f'"problem": "{problem}"' in written) == bool(problem), written
    assert ("127.0.0.1" in written) == bool(problem)


PARTS = f"/hooks/{SECRET}?sig=s1gn4ture&x=1"
LEVELS = pytest.mark.parametrize("level", ["info", "debug"])
FORMS = pytest.mark.parametrize("as_json", [True, False], ids=["json", "console"])
WAYS = [
    (204, "sent", ""),
    (307, "failed", "redirect"),
    (410, "failed", "gone"),
    (503, "failed", "status 503"),
    (404, "failed", "status 404"),
]


@LEVELS
@FORMS
@pytest.mark.parametrize(("status", "result", "problem"), WAYS, ids=[str(status) for status, _, _ in WAYS])
def test_an_answer(log_state, receiver, capsys, level, as_json, status, result, problem):
    receiver.statuses = [status] * 2
    sent(f"{receiver.origin}{PARTS}", level, as_json, result)
    assert receiver.got[0][0] == PARTS
    shown = problem if as_json or " " not in problem else f"'{problem}'"
    check(capsys.readouterr().err, shown)


@LEVELS
@FORMS
def test_a_timeout(log_state, receiver, capsys, monkeypatch, level, as_json):
    monkeypatch.setattr(sender_module, "TIMEOUT_S", 0.2)
    receiver.gate.clear()
    sent(f"{receiver.origin}{PARTS}", level, as_json, "failed")
    check(capsys.readouterr().err, "timeout")


@LEVELS
@FORMS
def test_a_refused_connection(log_state, receiver, capsys, level, as_json):
    sent(f"http://127.0.0.1:{free_port()}{PARTS}", level, as_json, "failed")
    check(capsys.readouterr().err, "ConnectError")


@LEVELS
@FORMS
def test_a_defect(log_state, receiver, capsys, monkeypatch, level, as_json):
    """Its traceback has what the error says, which may be the URL."""

    def fail(*_: object) -> dict[str, str]:
        raise RuntimeError(f"cannot post to {receiver.origin}{PARTS}")

    monkeypatch.setattr(sender_module, "signed_headers", fail)
    sent(f"{receiver.origin}{PARTS}", level, as_json, "failed")
    written = capsys.readouterr().err
    assert "cannot post to http://127.0.0.1" in written
    check(written.replace("127.0.0.1", ""), "")
