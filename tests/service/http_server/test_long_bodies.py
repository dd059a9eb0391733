"""Long bodies, received right into their place: in any pieces, cut off, refused, one after the other."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from firstfix_service.http_api.bodies.request_body import LONG_BYTES
from tests.service.raw_connection import all_of, connect
from tests.service.service_world import XYZ, Service, publish, running_service
from tests.waiting import let_pass, wait_until

POINTS = 100_000
BODY = bytes(12 * POINTS)
HEALTH = b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("service"), zenoh=False) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        assert running.ask_http().ok
        yield running


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


def body_bytes_held(service: Service) -> float:
    lines = service.http.get("/metrics").text.splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("firstfix_body_bytes "))


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


def test_requests_may_follow_at_once(service: Service):
    with connect(service) as connection:
        bodies = [bytes(12 * count) for count in (POINTS, 20, 60_000)]
        connection.sendall(b"".join(head(len(body)) + body for body in bodies) + HEALTH)
        found = answers(connection, 4)
        assert points_in(found) == [POINTS, 20, 60_000]
        assert found.count(b"HTTP/1.1 200") == 4


def test_a_body_just_long_enough(service: Service):
    with connect(service) as connection:
        for length in (LONG_BYTES - LONG_BYTES % 12, LONG_BYTES + 12 - LONG_BYTES % 12):
            connection.sendall(head(length) + bytes(length))
            assert points_in(answers(connection, 1)) == [length // 12]


def test_who_waits_for_100_continue_gets_it(service: Service):
    with connect(service) as connection:
        connection.sendall(head(len(BODY), "Expect: 100-continue"))
        assert connection.recv(1 << 16) == b"HTTP/1.1 100 Continue\r\n\r\n"
        connection.sendall(BODY)
        assert points_in(answers(connection, 1)) == [POINTS]


def test_a_caller_who_asks_for_the_end_gets_it(service: Service):
    with connect(service) as connection:
        connection.sendall(head(len(BODY), "Connection: close") + BODY)
        found = all_of(connection)
        assert points_in(found) == [POINTS]
        assert b"connection: close" in found.lower()


@pytest.mark.parametrize("sent", [1, 100_000, len(BODY) - 1])
def test_a_caller_who_goes_leaves_nothing_behind(service: Service, sent: int):
    with connect(service) as connection:
        connection.sendall(head(len(BODY)) + BODY[:sent])
        wait_until(lambda: body_bytes_held(service) >= sent)
    wait_until(lambda: body_bytes_held(service) == 0)
    with connect(service) as connection:
        connection.sendall(head(len(BODY)) + BODY[:sent])
        connection.shutdown(socket.SHUT_WR)
        assert all_of(connection) == b""
    assert service.ask_http().ok


def test_a_body_that_stops_is_given_up_and_its_rest_is_no_request(tmp_path: Path):
    with running_service(tmp_path, zenoh=False, body_timeout_s=0.5) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        with connect(service) as connection:
            connection.sendall(head(len(BODY)) + BODY[:100_000])
            assert connection.recv(1 << 16).startswith(b"HTTP/1.1 504")
            connection.sendall(HEALTH * 10)
            assert b"HTTP/1.1" not in all_of(connection)
        wait_until(lambda: body_bytes_held(service) == 0)


def test_a_body_refused_on_the_way_smuggles_no_request(tmp_path: Path):
    """The limit of all bodies is reached in the middle; what comes after it looks like requests."""
    with running_service(tmp_path, zenoh=False, max_inflight_bytes=300_000) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        body = bytes(200_000) + HEALTH * 20_000
        with connect(service) as connection:
            connection.sendall(head(len(body)) + body[:150_000])
            wait_until(lambda: body_bytes_held(service) >= 150_000)
            with suppress(ConnectionError):
                connection.sendall(body[150_000:] + HEALTH)
            found = all_of(connection)
        assert found.count(b"HTTP/1.1 ") <= 1
        assert b" 200 " not in found
        wait_until(lambda: body_bytes_held(service) == 0)
        assert service.ask_http().ok


def test_memory_is_taken_as_bytes_arrive(tmp_path: Path):
    """Long bodies that are only announced leave room for the others."""
    with running_service(tmp_path, zenoh=False, max_inflight_bytes=3_000_000) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        idle = [connect(service) for _ in range(30)]
        for connection in idle:
            connection.sendall(head(len(BODY)) + bytes(1200))
        wait_until(lambda: body_bytes_held(service) >= 30 * 1200)
        with connect(service) as connection:
            connection.sendall(head(len(BODY)) + BODY)
            assert points_in(answers(connection, 1)) == [POINTS]
        for connection in idle:
            connection.close()
