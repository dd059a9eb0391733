"""Scans to be looked at are decoded as those of queries are: by a worker process, in turn, within a time."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import pytest

from firstfix.catalog.manifest import Manifest
from tests.service.query_worker_pids import Workers
from tests.service.raw_connection import connect
from tests.service.service_world import SCAN_BODY, XYZ, Behaviour, Service, publish, running_service
from tests.waiting import LIMIT_S, wait_until

POINTS = np.random.default_rng(2).uniform(-8, 8, (3000, 3)).astype("<f4")
ROUTES = ["scan-report", "overlay"]


@dataclass
class Looking:
    """A service with one worker process, and its map "yard"."""

    service: Service
    workers: Workers
    version: str

    def path(self, route: str) -> str:
        if route == "scan-report":
            return "/scan-report"
        return f"/maps/yard/versions/{self.version}/overlay?T_map_sensor=0,0,1,0,0,0,1"

    def look(self, route: str, body: bytes = POINTS.tobytes()) -> httpx.Response:
        return self.service.http.post(self.path(route), content=body, headers={"Content-Type": XYZ})

    @property
    def body_bytes(self) -> float:
        return self.service.value("firstfix_body_bytes")


def head_of(path: str) -> bytes:
    """Of a body of 1200 bytes."""
    named = f"Host: h\r\nContent-Type: {XYZ}\r\nContent-Length: 1200\r\n"
    return f"POST {path} HTTP/1.1\r\n{named}\r\n".encode()


@pytest.fixture
def looking(tmp_path: Path, small_version, request: pytest.FixtureRequest) -> Iterator[Looking]:
    workers, changes = Workers(), getattr(request, "param", {})
    with running_service(tmp_path, zenoh=False, load=None, workers=1, **changes) as service:
        folder = small_version.directory
        version = service.catalog.publish("yard", folder, Manifest.for_directory(folder))
        service.wait_until_loaded()
        yield Looking(service, workers, version)


@pytest.mark.parametrize("looking", [{"query_timeout_s": 1.5}], indirect=True)
def test_a_body_that_takes_long_is_given_up_with_its_process(looking: Looking):
    for route in ROUTES:
        wait_until(lambda route=route: looking.look(route).status_code == 200)
        (stuck,) = looking.workers.pids()
        os.kill(stuck, signal.SIGSTOP)  # it takes for ever
        late = looking.look(route)
        assert (late.status_code, late.json()["code"]) == (504, "deadline_exceeded"), route
        wait_until(lambda stuck=stuck: stuck not in looking.workers.pids())
        assert looking.body_bytes == 0, route


def test_a_process_that_dies_over_a_body_is_replaced_and_the_caller_answered(looking: Looking):
    for route in ROUTES:
        before = looking.look(route)
        (doomed,) = looking.workers.pids()
        os.kill(doomed, signal.SIGSTOP)
        with ThreadPoolExecutor(1) as threads:
            asked = threads.submit(looking.look, route)
            wait_until(lambda: looking.service.value("firstfix_queries_admitted") == 1)
            os.kill(doomed, signal.SIGKILL)
            answer = asked.result(LIMIT_S)
        assert answer.status_code == 200, answer.text
        assert answer.content == before.content, route


def test_without_room_a_look_is_refused_before_its_body_is_read(tmp_path: Path):
    behaviour = Behaviour(gate=threading.Event())
    with (
        running_service(tmp_path, zenoh=False, behaviour=behaviour, workers=1, queue_size=1) as service,
        ThreadPoolExecutor(2) as threads,
    ):
        version = publish(service.catalog, "hall", "1", service.scratch)
        service.wait_until_loaded()
        running = threads.submit(service.ask_http)
        assert behaviour.started.acquire(timeout=LIMIT_S)
        waiting = threads.submit(
            service.http.post, "/scan-report", content=SCAN_BODY, headers={"Content-Type": XYZ}
        )
        wait_until(lambda: service.value("firstfix_queries_admitted") == 2)
        overlay = f"/maps/hall/versions/{version}/overlay?T_map_sensor=0,0,1,0,0,0,1"
        for path in ("/scan-report", overlay):
            with connect(service) as connection:
                connection.sendall(head_of(path) + b"some of it")
                assert b" 503 " in connection.recv(1000).splitlines()[0], path
        service.open_gate()
        assert running.result(LIMIT_S).ok
        assert waiting.result(LIMIT_S).status_code == 200


def test_bodies_that_are_looked_at_count_with_those_of_queries(tmp_path: Path):
    with running_service(tmp_path, zenoh=False, max_inflight_bytes=2400) as service:
        version = publish(service.catalog, "hall", "1", service.scratch)
        service.wait_until_loaded()
        overlay = f"/maps/hall/versions/{version}/overlay?T_map_sensor=0,0,1,0,0,0,1"
        for path in ("/scan-report", overlay):
            with connect(service) as connection:
                connection.sendall(head_of(path) + bytes(1100))
                wait_until(lambda: service.value("firstfix_body_bytes") == 1100)
                refused = service.ask_http()
                assert refused.json["code"] == "overloaded", path
            wait_until(lambda: service.value("firstfix_body_bytes") == 0)
