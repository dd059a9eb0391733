"""Long bodies, received right into their place: in any pieces, cut off, refused, one after the other."""

from __future__ import annotations

import socket
from contextlib import suppress

import pytest

from firstfix_service.http_api.bodies.request_body import LONG_BYTES
from tests.service.raw_connection import all_of, connect
from tests.service.service_world import XYZ, Service, serving
from tests.waiting import let_pass, wait_until

pytestmark = serving(is_shared=True, zenoh=False)
POINTS = 100_000
BODY = bytes(12 * POINTS)
HEALTH = b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n"


def head(length: int, *headers: str) -> bytes:
    lines = ["POST /localize?map=hall HTTP/1.1", "Host: x", f"Content-Type: {XYZ}", *headers]
    return "\r\n".join([*lines, f"Content-Length: {length}", "", ""]).encode()


def answers(connection: socket.socket, count: int) -> bytes:
    """Reads until so many answers have come, or the service closes."""
    found = b""
    while found.count(b"HTTP/1.1 ") < count or not found.endswith((b"}", b"\n")):
        piece = connection.recv(1 << 16)
        if not piece:
            return found
        found += piece
    return found


def points_in(answer: bytes) -> list[int]:
    """Returns the points of each scan that was answered: the fake localizer gives them as y."""
    return [int(float(part.split(b",")[1])) for part in answer.split(b'"T_map_sensor":{"position":[')[1:]]


@pytest.mark.parametrize("first", [0, 1, 65_535, 70_000, len(BODY) - 1, len(BODY)])
def test_a_long_body_comes_in_any_pieces(service: Service, first: int):
    with connect(service) as connection:
        connection.sendall(head(len(BODY)) + BODY[:first])
        let_pass(0.05)  # it is read so far
        connection.sendall(BODY[first:])
        assert points_in(answers(connection, 1)) == [POINTS]


def test_the_connection_goes_on_after_a_long_body(service: Service):
    with connect(service) as connection:
        for count in (POINTS, 10, 50_000, POINTS):
            connection.sendall(head(12 * count) + bytes(12 * count))
            assert points_in(answers(connection, 1)) == [count]
        connection.sendall(HEALTH)
        assert answers(connection, 1).startswith(b"HTTP/1.1 200")


def test_pipelined_requests_are_answered(service: Service):
    with connect(service) as connection:
        bodies = [bytes(12 * count) for count in (POINTS, 20, 60_000)]
        connection.sendall(b"".join(head(len(body)) + body for body in bodies) + HEALTH)
        found = answers(connection, 4)
        assert points_in(found) == [POINTS, 20, 60_000]
        assert found.count(b"HTTP/1.1 200") == 4


def test_bodies_near_the_limit_of_long_ones_are_complete(service: Service):
    with connect(service) as connection:
        for length in (LONG_BYTES - LONG_BYTES % 12, LONG_BYTES + 12 - LONG_BYTES % 12):
            connection.sendall(head(length) + bytes(length))
            assert points_in(answers(connection, 1)) == [length // 12]


def test_100_continue_is_sent_to_a_caller_that_waits_for_it(service: Service):
    with connect(service) as connection:
        connection.sendall(head(len(BODY), "Expect: 100-continue"))
        assert connection.recv(1 << 16) == b"HTTP/1.1 100 Continue\r\n\r\n"
        connection.sendall(BODY)
        assert points_in(answers(connection, 1)) == [POINTS]


def test_connection_close_is_honoured(service: Service):
    with connect(service) as connection:
        connection.sendall(head(len(BODY), "Connection: close") + BODY)
        found = all_of(connection)
        assert points_in(found) == [POINTS]
        assert b"connection: close" in found.lower()


@pytest.mark.parametrize("sent", [1, 100_000, len(BODY) - 1])
def test_a_caller_that_leaves_frees_its_memory(service: Service, sent: int):
    with connect(service) as connection:
        connection.sendall(head(len(BODY)) + BODY[:sent])
        wait_until(lambda: service.value("firstfix_body_bytes") >= sent)
    wait_until(lambda: service.value("firstfix_body_bytes") == 0)
    with connect(service) as connection:
        connection.sendall(head(len(BODY)) + BODY[:sent])
        connection.shutdown(socket.SHUT_WR)
        assert all_of(connection) == b""
    assert service.ask_http().ok


@serving(zenoh=False, body_timeout_s=0.5)
def test_a_body_that_stalls_gets_504_and_its_rest_is_no_request(service: Service):
    with connect(service) as connection:
        connection.sendall(head(len(BODY)) + BODY[:100_000])
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 504")
        connection.sendall(HEALTH * 10)
        assert b"HTTP/1.1" not in all_of(connection)
    wait_until(lambda: service.value("firstfix_body_bytes") == 0)


@serving(zenoh=False, max_inflight_bytes=300_000)
def test_a_body_refused_on_the_way_smuggles_no_request(service: Service):
    """The limit of all bodies is reached in the middle; what comes after it looks like requests."""
    body = bytes(200_000) + HEALTH * 20_000
    with connect(service) as connection:
        connection.sendall(head(len(body)) + body[:150_000])
        wait_until(lambda: service.value("firstfix_body_bytes") >= 150_000)
        with suppress(ConnectionError):
            connection.sendall(body[150_000:] + HEALTH)
        found = all_of(connection)
    assert found.count(b"HTTP/1.1 ") <= 1
    assert b" 200 " not in found
    wait_until(lambda: service.value("firstfix_body_bytes") == 0)
    assert service.ask_http().ok


@serving(zenoh=False, max_inflight_bytes=3_000_000)
def test_memory_is_taken_as_bytes_arrive(service: Service):
    """Long bodies that are only announced leave room for the others."""
    idle = [connect(service) for _ in range(30)]
    for connection in idle:
        connection.sendall(head(len(BODY)) + bytes(1200))
    wait_until(lambda: service.value("firstfix_body_bytes") >= 30 * 1200)
    with connect(service) as connection:
        connection.sendall(head(len(BODY)) + BODY)
        assert points_in(answers(connection, 1)) == [POINTS]
    for connection in idle:
        connection.close()
