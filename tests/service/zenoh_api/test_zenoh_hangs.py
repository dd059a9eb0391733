"""zenoh whose calls or router hang: HTTP goes on, the watchdog sees it, and the service can stop."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from firstfix.answer.localization import Verdict
from firstfix.scan.scan import Scan
from firstfix_client import ZenohClient
from firstfix_service.limits.limits import Limits
from firstfix_service.zenoh_api import endpoint
from firstfix_service.zenoh_api.replies import ReplyThreads
from tests.servers import free_port
from tests.service.service_world import publish, running_service, served
from tests.service.zenoh_world import running_router
from tests.waiting import LIMIT_S, wait_until


class HangingInfo:
    """Asks a session about itself, and does not come back while zenoh hangs."""

    def __init__(self, session: Any, go_on: threading.Event, threads: set[str]) -> None:
        self._info = session.info
        self._go_on, self._threads = go_on, threads

    def links(self) -> list[Any]:
        self._threads.add(threading.current_thread().name)
        assert self._go_on.wait(2 * LIMIT_S)
        return list(self._info.links())


class HangingSession:
    """A real session with some calls that hang."""

    def __init__(self, session: Any, go_on: threading.Event) -> None:
        self._session = session
        self._go_on = go_on
        self.threads: set[str] = set()  # names of those that hang

    @property
    def info(self) -> HangingInfo:
        return HangingInfo(self._session, self._go_on, self.threads)

    def close(self) -> None:
        self.threads.add(threading.current_thread().name)
        assert self._go_on.wait(2 * LIMIT_S)
        self._session.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)


@pytest.fixture
def hanging(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[HangingSession]]:
    go_on = threading.Event()
    made: list[HangingSession] = []

    class Zenoh:
        ZError = zenoh.ZError
        KeyExpr = zenoh.KeyExpr

        @staticmethod
        def open(config: Any) -> HangingSession:
            made.append(HangingSession(zenoh.open(config), go_on))
            return made[-1]

    monkeypatch.setattr(endpoint, "zenoh", Zenoh)
    monkeypatch.setattr(endpoint, "DRAIN_S", 0.1)
    yield made
    go_on.set()


@pytest.mark.slow
def test_a_hanging_session_holds_up_neither_requests_nor_the_stop(
    tmp_path: Path, hanging: list[HangingSession]
):
    with running_service(tmp_path) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        (session,) = hanging
        wait_until(lambda: session.threads)
        assert service.http.get("/metrics").is_success
        assert service.ask_http().ok
        assert service.ask_zenoh().ok
        wait_until(lambda: service.http.get("/healthz").status_code == 503)
        problem = service.http.get("/healthz").json()
        assert problem["code"] == "overloaded"
        assert problem["detail"].startswith("zenoh has not come back for")
        assert service.http.get("/readyz").status_code == 503
        assert service.ask_http().ok
        publish(service.catalog, "hall", "2", service.scratch)
        wait_until(lambda: service.ask_http().x == 2)  # the maps follow the store
    # The service has stopped, although the session has not closed.
    assert session.threads == {"zenoh-watch", "zenoh-call"}


class Asked:
    """A query whose caller reads nothing until ``reads`` is set."""

    def __init__(self, reads: threading.Event | None = None) -> None:
        self.reads = reads
        self.is_ended = threading.Event()

    def __enter__(self) -> Asked:
        return self

    def __exit__(self, *_: object) -> None:
        self.is_ended.set()

    def reply(self) -> None:
        if self.reads is not None:
            assert self.reads.wait(LIMIT_S)


def test_replies_that_wait_hold_up_no_others():
    reads = threading.Event()
    replies = ReplyThreads()
    waiting = [Asked(reads) for _ in range(Limits.max_replies - 1)]
    sent = [replies.send(one, one.reply, "frozen") for one in waiting]
    other = Asked()
    replies.send(other, other.reply, "robot").result(LIMIT_S)
    assert other.is_ended.is_set()
    assert len(replies) == Limits.max_replies - 1
    assert not any(one.done() for one in sent)
    reads.set()
    for one in sent:
        one.result(LIMIT_S)
    wait_until(lambda: len(replies) == 0)
    replies.close()


def test_a_caller_has_at_most_half_of_the_threads():
    reads = threading.Event()
    replies = ReplyThreads()
    for _ in range(Limits.max_replies_per_caller):
        assert not replies.is_full_for("frozen")
        one = Asked(reads)
        replies.send(one, one.reply, "frozen")
    assert replies.is_full_for("frozen")
    assert not replies.is_full_for("robot")
    assert not replies.is_full
    reads.set()
    wait_until(lambda: not replies.is_full_for("frozen"))
    replies.close()


def test_the_error_of_a_reply_comes_back_and_its_query_is_ended():
    def fail() -> None:
        raise zenoh.ZError("gone")

    replies = ReplyThreads()
    asked = Asked()
    sent: Future[None] = replies.send(asked, fail)
    assert isinstance(sent.exception(LIMIT_S), zenoh.ZError)
    assert asked.is_ended.is_set()
    replies.close()


NEVER_MS = 3_600_000  # time after which zenoh gives up a silent connection; by default 10 s


def config(path: Path, mode: str, **changes: object) -> Path:
    common = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tx": {"lease": NEVER_MS}}},
    }
    path.write_text(json.dumps({**common, **changes}))
    return path


@pytest.mark.slow
def test_a_robot_beside_a_frozen_router_is_answered(tmp_path):
    port, own = free_port(), f"tcp/127.0.0.1:{free_port()}"
    listen = {"endpoints": [f"tcp/127.0.0.1:{port}"]}
    file = config(tmp_path / "router.json5", "router", listen=listen)
    peer = config(tmp_path / "service.json5", "peer", listen={"endpoints": [own]}, connect=listen)
    scan = Scan.from_points(np.random.default_rng(1).uniform(-9, 9, (300, 3)))
    with (
        running_router(file, port) as router,
        served(tmp_path, zenoh_config=peer, zenoh_listen=(own,)) as service,
        ZenohClient(service.endpoint, timeout_s=2 * LIMIT_S) as client,
        ThreadPoolExecutor(1) as thread,
    ):
        wait_until(lambda: "firstfix_zenoh_connections 3.0" in service.http.get("/metrics").text)
        assert client.localize(scan, map_id="hall").verdict is Verdict.LOCALIZED
        router.send_signal(signal.SIGSTOP)
        try:
            # zenoh asks the router too, and the query ends when that has answered, or at its deadline.
            asked = thread.submit(client.localize, scan, map_id="hall")
            assert asked.result(LIMIT_S).verdict is Verdict.LOCALIZED
        finally:
            router.send_signal(signal.SIGCONT)
