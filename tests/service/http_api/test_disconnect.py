"""Callers who disconnect, and slow maps, over real sockets."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Behaviour,
    FakeLocalizer,
    Service,
    publish,
    running_service,
)
from tests.waiting import LIMIT_S, wait_until


@pytest.fixture
def gated(tmp_path: Path) -> Iterator[Service]:
    behaviour = Behaviour(gate=threading.Event())
    with running_service(tmp_path, behaviour=behaviour, zenoh=False, workers=1, queue_size=4) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        yield service


def admitted(service: Service) -> float:
    lines = service.http.get("/metrics").text.splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("firstfix_queries_admitted "))


def send_query(service: Service) -> socket.socket:
    """Sends a query and does not read the answer."""
    host, port = service.url.removeprefix("http://").split(":")
    connection = socket.create_connection((host, int(port)))
    head = f"POST /localize?map=hall HTTP/1.1\r\nHost: {host}\r\nContent-Type: {XYZ}\r\n"
    connection.sendall(f"{head}Content-Length: {len(SCAN_BODY)}\r\n\r\n".encode() + SCAN_BODY)
    return connection


def test_a_query_whose_caller_has_gone_leaves_the_queue(gated: Service):
    running = send_query(gated)
    assert gated.behaviour.started.acquire(timeout=LIMIT_S)
    waiting = [send_query(gated) for _ in range(3)]
    wait_until(lambda: admitted(gated) == 4)
    for connection in waiting:
        connection.close()
    wait_until(lambda: admitted(gated) == 1)
    assert 'firstfix_localize_failures_total{code="client_gone",transport="http"} 3.0' in (
        gated.http.get("/metrics").text
    )
    assert "firstfix_body_bytes 1200.0" in gated.http.get("/metrics").text
    assert gated.behaviour.gate is not None
    gated.behaviour.gate.set()
    assert b"200 OK" in running.recv(100)
    running.close()
    wait_until(lambda: admitted(gated) == 0)
    assert not gated.behaviour.started.acquire(blocking=False), "they were never begun"


def test_a_query_that_runs_keeps_its_place_when_its_caller_has_gone(gated: Service):
    connection = send_query(gated)
    assert gated.behaviour.started.acquire(timeout=LIMIT_S)
    connection.close()
    wait_until(lambda: "client_gone" in gated.http.get("/metrics").text)
    assert admitted(gated) == 1
    assert gated.behaviour.gate is not None
    gated.behaviour.gate.set()
    wait_until(lambda: admitted(gated) == 0)
    assert gated.ask("http").ok


def test_a_map_that_is_being_loaded_keeps_nobody_elses_queries_out(tmp_path: Path):
    """Queries of a slow map fill the queue; those of a loaded map are still answered."""
    behaviour, gate = Behaviour(), threading.Event()

    def load(directory: Path) -> FakeLocalizer:
        if (directory / "label.txt").read_text() == "9":
            assert gate.wait(LIMIT_S)
        return behaviour.load(directory)

    with (
        running_service(tmp_path, load=load, zenoh=False, workers=1, queue_size=5) as service,
        ThreadPoolExecutor(6) as threads,
    ):
        try:
            publish(service.catalog, "hall", "1", service.scratch)
            assert service.ask("http").ok
            publish(service.catalog, "huge", "9", service.scratch)
            asked = [threads.submit(service.ask, "http", map_id="huge") for _ in range(6)]
            wait_until(lambda: admitted(service) == 6)
            for _ in range(10):
                assert service.ask("http").x == 1
        finally:
            gate.set()
        codes = [one.result(LIMIT_S).json.get("code", "ok") for one in asked]
        assert set(codes) <= {"ok", "overloaded"}
        assert codes.count("ok") >= 4
