"""One gate for both transports: its bytes are counted together, and every wait before it counts."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from service_world import SCAN_BODY, Behaviour, Service, publish, running_service

from waiting import LIMIT_S, wait_until

BODY = SCAN_BODY[:720]
LIMIT_BYTES = 1200  # for one body, and not for two


def bytes_held(service: Service) -> float:
    lines = service.http.get("/metrics").text.splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("firstfix_body_bytes "))


@pytest.mark.parametrize(("first", "second"), [("http", "zenoh"), ("zenoh", "http")])
def test_the_bodies_of_both_transports_have_one_limit(tmp_path: Path, first: str, second: str):
    behaviour = Behaviour(gate=threading.Event())
    with (
        running_service(tmp_path, behaviour=behaviour, max_inflight_bytes=LIMIT_BYTES) as service,
        ThreadPoolExecutor(2) as threads,
    ):
        publish(service.catalog, "hall", "1", service.scratch)
        waiting = threads.submit(service.ask, first, body=BODY)
        assert behaviour.started.acquire(timeout=LIMIT_S)
        asked = threads.submit(service.ask, second, body=BODY)
        wait_until(lambda: asked.done() or behaviour.started.acquire(blocking=False))
        held = bytes_held(service)
        assert behaviour.gate is not None
        behaviour.gate.set()
        refused = asked.result(LIMIT_S)
        assert (refused.json["code"], refused.json["status"], held) == ("overloaded", 503, 720)
        assert waiting.result(LIMIT_S).ok
        wait_until(lambda: service.ask(second, body=BODY).ok)  # a body is let go just after its answer
