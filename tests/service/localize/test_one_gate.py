"""One gate for both transports: its bytes are counted together, and every wait before it counts."""

from __future__ import annotations

import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import ClassVar
from urllib.parse import urlsplit

import pytest

from firstfix.answer.localization import Localization
from firstfix_service.http_api.parts import LocalizeParts
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Behaviour,
    FakeLocalizer,
    Service,
    publish,
    running_service,
)
from tests.waiting import LIMIT_S, let_pass, wait_until

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


class Timed(Behaviour):
    """Records the deadline that the engine is given."""

    def load(self, directory: Path) -> FakeLocalizer:
        return TimedLocalizer(1.0, self)


class TimedLocalizer(FakeLocalizer):
    deadlines: ClassVar[list[float]] = []

    def localize(self, scan, options=None, deadline=None) -> Localization:
        self.deadlines.append(deadline.at)
        return super().localize(scan, options, deadline)


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_the_engines_deadline_counts_every_wait(tmp_path: Path, transport: str):
    """The only worker is away when the query comes, as a process that is being replaced."""
    with (
        running_service(tmp_path, behaviour=Timed(), workers=1) as service,
        ThreadPoolExecutor(1) as threads,
    ):
        publish(service.catalog, "hall", "1", service.scratch)
        assert service.ask(transport, options={"deadline_ms": "600000"}).ok  # has loaded the map
        gate = service.app.state.start.parts[LocalizeParts].use_case._gate
        worker = gate._free.pop()
        begun = time.monotonic()
        asked = threads.submit(service.ask, transport, options={"deadline_ms": "600000"})
        wait_until(lambda: gate.admitted == 1)
        came = time.monotonic()
        let_pass(0.5)
        gate.add_worker(worker)
        reply = asked.result(LIMIT_S)
        assert reply.ok
        assert begun + 600 <= TimedLocalizer.deadlines[-1] <= came + 600
        assert reply.json["timings_ms"]["queue"] >= 400, "and the answer tells of it"


def test_a_prior_of_several_maps_is_refused_before_the_body(service: Service):
    host, port = urlsplit(service.url).netloc.split(":")
    for option in ("prior=1,2,3,4", f"version={'0' * 64}"):
        with socket.create_connection((host, int(port)), timeout=LIMIT_S) as connection:
            head = f"POST /localize?map=hall,yard&{option} HTTP/1.1\r\nHost: x\r\nContent-Type: {XYZ}\r\n"
            connection.sendall(f"{head}Content-Length: 1200\r\n\r\n".encode())
            answer = connection.recv(65_536)
        assert answer.startswith(b"HTTP/1.1 400 "), option
        assert b"invalid_option" in answer
