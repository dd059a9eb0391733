"""Callers that end their own direction after a request, and wait for the answer; and those that are gone."""

from __future__ import annotations

import socket

import pytest

from firstfix_service.limits import connections
from tests.service.raw_connection import all_of, connect
from tests.service.service_world import SCAN_BODY, XYZ, Service, serving
from tests.waiting import LIMIT_S, let_pass, wait_until

pytestmark = serving(zenoh=False, is_gated=True, workers=1, queue_size=4)
GET = b"GET /maps HTTP/1.%d\r\nHost: x\r\n\r\n"


def query(version: int = 1) -> bytes:
    head = f"POST /localize?map=hall HTTP/1.{version}\r\nHost: x\r\nContent-Type: {XYZ}\r\n"
    return f"{head}Content-Length: {len(SCAN_BODY)}\r\n\r\n".encode() + SCAN_BODY


@pytest.mark.parametrize("version", [0, 1])
def test_a_half_closed_caller_gets_its_answer(service: Service, version: int):
    with connect(service) as connection:
        connection.sendall(query(version))
        wait_until(lambda: service.value("firstfix_queries_admitted") == 1)
        connection.shutdown(socket.SHUT_WR)
        let_pass(0.5)  # several looks whether the caller is gone
        assert service.value("firstfix_queries_admitted") == 1
        service.open_gate()
        found = all_of(connection)
    assert b"100 Continue" not in found or version == 1, "HTTP/1.0 has no interim responses"
    assert found.count(b"HTTP/1.1 200 OK") == 1
    assert b"connection: close" in found
    assert found.endswith(b"}")


def test_pipelined_requests_are_answered_to_the_last(service: Service):
    with connect(service) as connection:
        connection.sendall(query() + GET % 1 * 3 + b"GET /maps HTT")
        connection.shutdown(socket.SHUT_WR)
        wait_until(lambda: service.value("firstfix_queries_admitted") == 1)
        service.open_gate()
        found = all_of(connection)
    assert found.count(b"HTTP/1.1 200 OK") == 4


def test_an_answer_under_way_is_completed(service: Service):
    """The answer has begun when the caller ends its direction."""
    with connect(service) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: x\r\n\r\n")
        begin = connection.recv(1000)
        connection.shutdown(socket.SHUT_WR)
        found = begin + all_of(connection)
    head, _, body = found.partition(b"\r\n\r\n")
    assert f"content-length: {len(body)}".encode() in head.lower()


@pytest.fixture(autouse=True)
def quick(monkeypatch) -> None:
    monkeypatch.setattr(connections, "CHECK_S", 0.1)


def test_a_query_whose_caller_has_gone_leaves_the_queue(service):
    running, *waiting = (connect(service) for _ in range(4))
    running.sendall(query(version=0))  # the service closes it after its answer
    assert service.behaviour.started.acquire(timeout=LIMIT_S)
    for connection in waiting:
        connection.sendall(query())
    wait_until(lambda: service.value("firstfix_queries_admitted") == 4)
    for connection in waiting:
        connection.close()
    wait_until(lambda: service.value("firstfix_queries_admitted") == 1)
    labels = {"code": "client_gone", "transport": "http"}
    assert service.value("firstfix_localize_failures_total", **labels) == 3
    assert service.value("firstfix_body_bytes") == len(SCAN_BODY)
    service.open_gate()
    assert all_of(running).count(b"HTTP/1.1 200 OK") == 1
    running.close()
    wait_until(lambda: service.value("firstfix_queries_admitted") == 0)
    assert not service.behaviour.started.acquire(blocking=False), "they were never begun"
