"""Callers that end their own direction after a request, and wait for the answer; and those that are gone."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from firstfix_service.http_api.event_stream import EventStreams
from firstfix_service.limits import connections
from tests.service.raw_connection import all_of, connect
from tests.service.service_world import SCAN_BODY, XYZ, Behaviour, Service, publish, running_service
from tests.waiting import let_pass, wait_until

GET = b"GET /maps HTTP/1.%d\r\nHost: x\r\n\r\n"


@pytest.fixture
def service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Service]:
    monkeypatch.setattr(connections, "CHECK_S", 0.1)
    behaviour = Behaviour(gate=threading.Event())
    with running_service(tmp_path, zenoh=False, behaviour=behaviour, workers=1) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        wait_until(lambda: running.http.get("/readyz").json().get("maps") == 1)
        running.http.close()
        yield running


def query(version: int = 1) -> bytes:
    head = f"POST /localize?map=hall HTTP/1.{version}\r\nHost: x\r\nContent-Type: {XYZ}\r\n"
    return f"{head}Content-Length: {len(SCAN_BODY)}\r\n\r\n".encode() + SCAN_BODY


def admitted(service: Service) -> int:
    return int(service.app.state.metrics.registry.get_sample_value("firstfix_queries_admitted"))


def open_gate(service: Service) -> None:
    assert service.behaviour.gate is not None
    service.behaviour.gate.set()


@pytest.mark.parametrize("version", [0, 1])
def test_a_caller_that_waits_gets_its_answer(service: Service, version: int):
    with connect(service) as connection:
        connection.sendall(query(version))
        wait_until(lambda: admitted(service) == 1)
        connection.shutdown(socket.SHUT_WR)
        let_pass(0.5)  # several looks whether the caller is gone
        assert admitted(service) == 1
        open_gate(service)
        found = all_of(connection)
    assert b"100 Continue" not in found or version == 1, "HTTP/1.0 has no interim responses"
    assert found.count(b"HTTP/1.1 200 OK") == 1
    assert b"connection: close" in found
    assert found.endswith(b"}")


def test_pipelined_requests_are_answered_to_the_last(service: Service):
    with connect(service) as connection:
        connection.sendall(query() + GET % 1 * 3 + b"GET /maps HTT")
        connection.shutdown(socket.SHUT_WR)
        wait_until(lambda: admitted(service) == 1)
        open_gate(service)
        found = all_of(connection)
    assert found.count(b"HTTP/1.1 200 OK") == 4


def test_an_answer_under_way_is_ended_properly(service: Service):
    """The answer has begun when the caller ends its direction."""
    with connect(service) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: x\r\n\r\n")
        begin = connection.recv(1000)
        connection.shutdown(socket.SHUT_WR)
        found = begin + all_of(connection)
    head, _, body = found.partition(b"\r\n\r\n")
    assert f"content-length: {len(body)}".encode() in head.lower()


def test_the_work_for_a_caller_that_is_gone_ends(service: Service):
    asking = [connect(service) for _ in range(3)]
    for connection in asking:
        connection.sendall(query())
    wait_until(lambda: admitted(service) == 3)
    for connection in asking:
        connection.close()
    wait_until(lambda: admitted(service) <= 1)  # one is in the worker
    open_gate(service)
    wait_until(lambda: admitted(service) == 0)


def test_a_stream_ends_with_its_caller(service: Service):
    with connect(service) as connection:
        connection.sendall(b"GET /answers/events HTTP/1.1\r\nHost: x\r\n\r\n")
        assert b"watching" in connection.recv(1 << 16)
        connection.shutdown(socket.SHUT_WR)
        wait_until(lambda: service.app.state.start.parts[EventStreams].limit.taken == 0)
