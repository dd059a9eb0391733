"""HTTP protocol of the service: raw bytes of a hostile caller."""

from __future__ import annotations

import socket

import pytest

from tests.service.raw_connection import all_of, connect
from tests.service.service_world import SCAN_BODY, XYZ, Service, serving
from tests.waiting import wait_until

pytestmark = serving(zenoh=False, body_timeout_s=1.0)

HEAD = b"POST /localize?map=hall HTTP/1.1\r\nHost: x\r\nContent-Type: " + XYZ.encode() + b"\r\n"
GET = b"GET /healthz HTTP/1.1\r\nHost: x\r\n"
FLOOD_BYTES = 64 << 20


def exchange(service: Service, *pieces: bytes) -> bytes:
    with connect(service) as connection:
        for piece in pieces:
            connection.sendall(piece)
        connection.shutdown(socket.SHUT_WR)
        return all_of(connection)


def flood(service: Service, start: bytes, piece: bytes) -> tuple[int, bytes]:
    """Returns the number of bytes of a flood that were accepted, and the answer."""
    sent = 0
    with connect(service) as connection:
        try:
            connection.sendall(start)
            while sent < FLOOD_BYTES:
                connection.sendall(piece)
                sent += len(piece)
        except ConnectionError:
            pass
        return sent, all_of(connection)


FLOODS = {
    "many headers": (GET, b"X-A: b\r\n" * 8192),
    "one long header": (GET + b"X-A: ", b"b" * 65536),
    "one long name": (GET, b"b" * 65536),
    "a long path": (b"GET /", b"b" * 65536),
    "a long method": (b"", b"G" * 65536),
    "empty lines": (b"", b"\r\n" * 32768),
    "trailers": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n1\r\nx\r\n0\r\n", b"X-A: b\r\n" * 8192),
    "one long trailer": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n0\r\nX-A: ", b"b" * 65536),
    "a chunk extension": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n1;a=", b"b" * 65536),
    "a chunk size": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n", b"0" * 65536),
}


@pytest.mark.parametrize("kind", FLOODS)
def test_an_endless_head_is_cut_off(service: Service, kind: str):
    sent, answer = flood(service, *FLOODS[kind])
    assert sent < FLOOD_BYTES, "the rest was not taken"
    assert b" 200 " not in answer.split(b"\r\n")[0]
    assert service.http.get("/healthz").is_success


def test_a_head_of_30_kB_is_accepted(service: Service):
    padding = b"X-A: " + b"b" * 30_000 + b"\r\n"
    assert exchange(service, GET + padding + b"Connection: close\r\n\r\n").startswith(b"HTTP/1.1 200")


AMBIGUOUS = {
    "two lengths": HEAD + b"Content-Length: 12\r\nContent-Length: 13\r\n\r\n" + bytes(13),
    "two equal lengths": HEAD + b"Content-Length: 12\r\nContent-Length: 12\r\n\r\n" + bytes(12),
    "length and chunks": HEAD + b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "a length that is none": HEAD + b"Content-Length: 0x10\r\n\r\n" + bytes(16),
    "a negative length": HEAD + b"Content-Length: -1\r\n\r\n",
    "a length beyond numbers": HEAD + b"Content-Length: " + b"9" * 40 + b"\r\n\r\n",
    "a chunk size that is none": HEAD + b"Transfer-Encoding: chunked\r\n\r\nzz\r\n",
    "a chunk beyond numbers": HEAD + b"Transfer-Encoding: chunked\r\n\r\n" + b"f" * 20 + b"\r\n",
    "a space in a header's name": GET + b"X A: b\r\n\r\n",
    "a null in a header": GET + b"X-A: b\x00c\r\n\r\n",
    "not HTTP": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(500),
    "a path beyond ASCII": b"GET /\xff\xfe HTTP/1.1\r\nHost: x\r\n\r\n",
}


@pytest.mark.parametrize("kind", AMBIGUOUS)
def test_ambiguous_requests_are_refused(service: Service, kind: str):
    answer = exchange(service, AMBIGUOUS[kind])
    assert answer.startswith(b"HTTP/1.1 4") or answer == b""
    assert b"HTTP/1.1 200" not in answer
    assert service.http.get("/healthz").is_success


HEADERS_IN_ONE_SEND = {
    "9,000 headers": GET + b"A: b\r\n" * 9000 + b"\r\n",
    "100 KB of headers": GET + (b"X-A: " + b"b" * 10_000 + b"\r\n") * 10 + b"\r\n",
    "a long path": b"GET /healthz?" + b"a" * 70_000 + b" HTTP/1.1\r\nHost: x\r\n\r\n",
}


@pytest.mark.parametrize("kind", HEADERS_IN_ONE_SEND)
def test_a_head_over_its_limits_gets_431(service: Service, kind: str):
    assert exchange(service, HEADERS_IN_ONE_SEND[kind]).startswith(b"HTTP/1.1 431")


def test_a_body_that_stalls_gets_504(service: Service):
    with connect(service) as connection:
        connection.sendall(HEAD + b"Content-Length: 1200\r\n\r\n" + SCAN_BODY[:12])
        answer = connection.recv(1 << 16)
    assert answer.startswith(b"HTTP/1.1 504")


def test_a_caller_that_leaves_frees_its_memory(service: Service):
    for _ in range(20):
        with connect(service) as connection:
            connection.sendall(HEAD + b"Content-Length: 1200\r\n\r\n" + SCAN_BODY[:600])
    wait_until(lambda: "firstfix_body_bytes 0.0" in service.http.get("/metrics").text)


def test_pipelined_requests_are_answered_in_order(service: Service):
    one = GET + b"X-Request-Id: n%d\r\n\r\n"
    with connect(service) as connection:
        connection.sendall(b"".join(one % n for n in range(50)) + GET + b"Connection: close\r\n\r\n")
        answer = all_of(connection)
    ids = [line for line in answer.split(b"\r\n") if line.startswith(b"x-request-id: n")]
    assert ids == [b"x-request-id: n%d" % n for n in range(50)]


@pytest.mark.parametrize("upgrade", [b"websocket", b"h2c", b"nonsense"])
def test_upgrades_are_ignored(service: Service, upgrade: bytes):
    key = b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    head = b"GET /maps HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: " + upgrade + b"\r\n" + key
    assert b"HTTP/1.1 101" not in exchange(service, head + b"\r\n")
    assert service.http.get("/healthz").is_success
