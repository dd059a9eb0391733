"""Limits of a zenoh replica: large payloads, many queries, and callers who do not read their answers."""

from __future__ import annotations

import dataclasses
import json
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from service_world import (
    SCAN_BODY,
    XYZ,
    Behaviour,
    FakeLocalizer,
    Service,
    client_session,
    free_port,
    publish,
    running_service,
)

from firstfix.answer.localization import Hypothesis, Localization, Verdict
from firstfix.answer.quality import AlignmentQuality
from waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow

ANSWERS_ASKED = 8
_ASKER = f"""
import json, sys, time, zenoh
config = zenoh.Config.from_json5(json.dumps({{"mode": "client", "connect": {{"endpoints": [sys.argv[1]]}},
                                             "scouting": {{"multicast": {{"enabled": False}}}}}}))
session = zenoh.open(config)
asked = [session.get("firstfix/hall/localize", payload=bytes(1200), encoding={XYZ!r}, timeout=600)
         for _ in range({ANSWERS_ASKED})]
print("asked", flush=True)
time.sleep(600)
"""


class Talkative(Behaviour):
    """Answers with megabytes: more than the buffers between two processes hold."""

    def load(self, directory: Path) -> FakeLocalizer:
        return TalkativeLocalizer(1.0, self)


class TalkativeLocalizer(FakeLocalizer):
    def localize(self, scan, options=None) -> Localization:
        answer = super().localize(scan, options)
        many = (Hypothesis(np.eye(4), AlignmentQuality(0.9, 0.8, 0.01), 0.9, 7),) * 20_000
        return dataclasses.replace(answer, verdict=Verdict.LOCALIZED, hypotheses=many)


def other_client(service: Service) -> Service:
    """The service through another session, which knows the service's keys already."""
    session = client_session(service.endpoint)
    wait_until(lambda: list(session.liveliness().get("firstfix/@any/localize/*", timeout=5)))
    return dataclasses.replace(service, session=session)


def is_answered_in_a_new_session(service: Service) -> bool:
    """Asks once. zenoh gives up a session that it could not serve for ten seconds."""
    other = other_client(service)
    try:
        replies = list(
            other.session.get("firstfix/hall/localize", payload=SCAN_BODY, encoding=XYZ, timeout=60)
        )
        return [reply.ok is not None for reply in replies] == [True]
    finally:
        other.session.close()


def metric(service: Service, name: str) -> float:
    lines = service.http.get("/metrics").text.splitlines()
    return sum(float(line.rsplit(" ", 1)[1]) for line in lines if line.startswith(name))


def test_a_message_over_the_limit_harms_nobody(tmp_path: Path):
    with running_service(tmp_path, zenoh_max_message_bytes=1 << 20) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        other = other_client(service)
        replies = other.session.get("firstfix/hall/localize", payload=bytes(3 << 20), encoding=XYZ, timeout=2)
        assert not any(reply.ok for reply in replies)
        assert metric(service, "firstfix_localize_failures_total") == 0, "the service has not seen it"
        assert service.ask_zenoh().ok
        assert other.ask_zenoh().ok, "also who sent it is answered"
        other.session.close()


def test_bodies_together_are_bounded(tmp_path: Path):
    behaviour = Behaviour(gate=threading.Event())
    limit = 6 * len(SCAN_BODY)  # of which one caller has half
    with (
        running_service(tmp_path, behaviour=behaviour, max_inflight_bytes=limit) as service,
        ThreadPoolExecutor(3) as threads,
    ):
        publish(service.catalog, "hall", "1", service.scratch)
        waiting = [threads.submit(service.ask_zenoh) for _ in range(3)]
        wait_until(lambda: metric(service, "firstfix_queries_admitted") == 3)
        refused = service.ask_zenoh()
        assert (refused.json["code"], refused.json["status"]) == ("overloaded", 503)
        behaviour.gate.set()
        assert all(reply.result().ok for reply in waiting)
        wait_until(lambda: service.ask_zenoh().ok)  # a body is let go just after its answer


def test_a_crowd_is_answered_or_refused_to_the_last_one(service: Service):
    def ask(_: int) -> str:
        reply = service.ask_zenoh()
        return "ok" if reply.ok else reply.json["code"]

    with ThreadPoolExecutor(64) as threads:
        outcomes = list(threads.map(ask, range(400)))
    assert set(outcomes) <= {"ok", "overloaded"}
    assert outcomes.count("ok") >= 34, "as many as have a place"
    wait_until(lambda: service.ask_zenoh().ok)  # its place is free just after its answer


def test_an_asker_who_takes_nothing_in_holds_nobody_up(tmp_path: Path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = tmp_path / "zenoh.json5"
    # The connection of an asker that takes nothing in is closed after so long. Replies to it may wait one
    # after the other: all of them together take less than the test may wait.
    congestion = {"congestion_control": {"block": {"wait_before_close": 30_000_000}}}
    config.write_text(
        json.dumps(
            {
                "mode": "peer",
                "listen": {"endpoints": [endpoint]},
                "scouting": {"multicast": {"enabled": False}},
                "transport": {"link": {"tx": {"queue": congestion}}},
            }
        )
    )
    behaviour = Talkative(gate=threading.Event())
    with running_service(
        tmp_path, behaviour=behaviour, zenoh_config=config, zenoh_listen=(endpoint,)
    ) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        asker = subprocess.Popen([sys.executable, "-c", _ASKER, endpoint], stdout=subprocess.PIPE)
        try:
            assert asker.stdout is not None
            assert asker.stdout.readline() == b"asked\n"
            wait_until(lambda: metric(service, "firstfix_queries_admitted") == ANSWERS_ASKED)
            connected = metric(service, "firstfix_zenoh_connections")
            asker.send_signal(signal.SIGSTOP)
            behaviour.gate.set()
            wait_until(lambda: metric(service, "firstfix_localizations_total") == ANSWERS_ASKED)
            for _ in range(3):
                assert service.ask_http().ok
            # nobody waited for the asker: its connection is still there
            assert metric(service, "firstfix_zenoh_connections") == connected
        finally:
            asker.kill()
            asker.wait()
        wait_until(lambda: is_answered_in_a_new_session(service))


def test_stopping_answers_all_who_wait(tmp_path: Path):
    behaviour = Behaviour(gate=threading.Event())
    with (
        ThreadPoolExecutor(5) as threads,
        running_service(tmp_path, behaviour=behaviour, workers=1) as service,
    ):
        publish(service.catalog, "hall", "1", service.scratch)
        asked = other_client(service)
        peer = asked.session
        waiting = [threads.submit(asked.ask_zenoh) for _ in range(5)]
        wait_until(lambda: metric(service, "firstfix_queries_admitted") == 5)
        service.stop()
        key = "firstfix/hall/localize/r1"
        wait_until(lambda: not list(peer.liveliness().get(key, timeout=5)))
        behaviour.gate.set()
        assert all(reply.result(LIMIT_S).ok for reply in waiting), "one worker, five queries"
        peer.close()
