"""Writes of an answer, the pace at which callers take it in, and their addresses."""

from __future__ import annotations

import asyncio
from ipaddress import ip_network
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from firstfix_service.http_server.protocol import LimitedHttpProtocol
from firstfix_service.http_server.streams import PIECE_BYTES, ReadingPace
from firstfix_service.limits.addresses import client_address
from firstfix_service.limits.connections import Connections
from firstfix_service.limits.limits import Limits
from firstfix_service.settings import Settings

REQUEST = b"%s / HTTP/1.1\r\nHost: x\r\nContent-Length: 0\r\n\r\n"
PIECES = [b"first", b"second"]


class Recorded(asyncio.Transport):
    """A transport that keeps what is written, write by write."""

    def __init__(self) -> None:
        super().__init__()
        self.writes: list[bytes] = []
        self.closed = False

    def write(self, data: Any) -> None:
        assert not self.closed
        self.writes.append(bytes(data))

    def get_write_buffer_size(self) -> int:
        return 0

    def is_closing(self) -> bool:
        return self.closed

    def close(self) -> None:
        self.closed = True

    def resume_reading(self) -> None: ...

    def pause_reading(self) -> None: ...


def connected(app: Any, transport: Recorded) -> LimitedHttpProtocol:
    """The protocol of a new connection to a server of this app."""
    config = uvicorn.Config(app, log_config=None, access_log=False, proxy_headers=False, lifespan="off")
    config.load()
    connections = Connections(Limits.of(Settings(store="memory://")), (), lambda why: None)
    room = memoryview(bytearray(PIECE_BYTES))
    protocol = LimitedHttpProtocol(config, ServerState(), {}, connections=connections, room=room)
    protocol.connection_made(transport)
    return protocol


def writes(*received: bytes, wait_between: bool = False, pieces: list[bytes] = PIECES) -> list[bytes]:
    """Returns the writes that the answers to a request take, which is received in pieces."""

    async def app(scope: Any, receive: Any, send: Any) -> None:
        while (await receive())["more_body"]:
            pass
        size = str(sum(map(len, pieces))).encode()
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", size)]})
        for number, piece in enumerate(pieces, 1):
            if wait_between:
                for _ in range(3):
                    await asyncio.sleep(0)
            await send({"type": "http.response.body", "body": piece, "more_body": number < len(pieces)})

    async def exchange() -> list[bytes]:
        transport = Recorded()
        protocol = connected(app, transport)
        for piece in received:
            protocol.data_received(piece)
            for _ in range(20):  # turns of the loop: nothing here waits for anything else
                await asyncio.sleep(0)
        return transport.writes

    return asyncio.run(exchange())


def test_a_head_and_the_first_piece_go_out_in_one_write():
    first, second = writes(REQUEST % b"POST")
    assert first.startswith(b"HTTP/1.1 200 OK\r\n")
    assert first.endswith(b"\r\n\r\nfirst")
    assert second == b"second"


def test_a_head_does_not_wait_for_a_body_that_comes_later():
    head, *body = writes(REQUEST % b"GET", wait_between=True)
    assert head.endswith(b"\r\n\r\n")
    assert body == PIECES


def test_an_answer_without_a_body_goes_out():
    for method in (b"GET", b"HEAD"):
        (head,) = writes(REQUEST % method, pieces=[b""])
        assert head.endswith(b"\r\n\r\n")


def test_100_continue_is_sent_before_the_answer():
    head = (REQUEST % b"POST").replace(b"Content-Length: 0", b"Content-Length: 2\r\nExpect: 100-continue")
    told, first, second = writes(head, b"ab")
    assert told == b"HTTP/1.1 100 Continue\r\n\r\n"
    assert first.startswith(b"HTTP/1.1 200 OK\r\n")
    assert first.endswith(b"first")
    assert second == b"second"


def test_two_pipelined_answers_are_complete():
    found = writes(REQUEST % b"POST" * 2)
    assert [piece.endswith(b"first") for piece in found] == [True, False, True, False]
    assert found[1] == found[3] == b"second"


def test_a_long_piece_goes_out_in_short_writes():
    long = bytes(range(256)) * 1000
    for method in (b"GET", b"POST"):
        found = writes(REQUEST % method, pieces=[long, b"end"])
        assert b"".join(found).partition(b"\r\n\r\n")[2] == long + b"end"
        assert len(found) > 4
        assert max(map(len, found)) < PIECE_BYTES + 300, "a piece, and a head"


def test_other_tasks_run_between_the_pieces_of_an_answer():
    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": bytes(4 * PIECE_BYTES)})

    async def exchange() -> list[int]:
        turns, seen = 0, []

        class Timed(Recorded):
            def write(self, data: Any) -> None:
                seen.append(turns)

        protocol = connected(app, Timed())
        protocol.data_received(REQUEST % b"GET")
        for turns in range(40):  # noqa: B007  # the transport reads it
            await asyncio.sleep(0)
        return seen

    first, *others = asyncio.run(exchange())
    assert len(others) >= 3, "the head goes out with the first piece"
    assert all(later > earlier for earlier, later in zip([first, *others], others, strict=False))


PROXIES = (ip_network("10.0.0.0/8"), ip_network("fd00::/8"))


@pytest.mark.parametrize(
    ("peer", "forwarded", "address"),
    [
        ("192.0.2.1", [], "192.0.2.1"),
        ("192.0.2.1", ["198.51.100.9"], "192.0.2.1"),  # written by a stranger
        ("10.0.0.1", ["198.51.100.9"], "198.51.100.9"),
        ("10.0.0.1", ["203.0.113.7, 198.51.100.9"], "198.51.100.9"),  # anybody can write the first one
        ("10.0.0.1", ["203.0.113.7", "198.51.100.9, 10.0.0.2"], "198.51.100.9"),
        ("10.0.0.1", ["10.0.0.3"], "10.0.0.3"),
        ("10.0.0.1", [], "10.0.0.1"),
        ("10.0.0.1", ["garbage"], "10.0.0.1"),
        ("10.0.0.1", ["198.51.100.9, garbage"], "10.0.0.1"),
        ("fd00::1", ["2001:db8:1:2:3:4:5:6"], "2001:db8:1:2::/64"),
        ("::ffff:192.0.2.1", [], "192.0.2.1"),
        ("2001:db8:1:2:3:4:5:7", [], "2001:db8:1:2::/64"),
        (None, ["198.51.100.9"], "unknown"),
        ("testclient", [], "unknown"),
    ],
)
def test_the_address_is_that_of_the_nearest_caller_behind_the_proxies(
    peer: str | None, forwarded: list[str], address: str
):
    assert client_address(peer, forwarded, PROXIES) == address


def test_forwarded_addresses_are_ignored_without_trusted_proxies():
    assert client_address("10.0.0.1", ["198.51.100.9"], ()) == "10.0.0.1"


ANSWER_S = 30.0
LARGE = 4_000_000


def is_cut_off(size_bytes: int, taken_per_s: float, seconds: int = 600) -> bool:
    """Returns whether a caller is too slow that takes an answer in at an even pace."""
    pace = ReadingPace(Limits(answer_timeout_s=ANSWER_S))
    pace.begin(size_bytes, 0)
    pace.wrote(size_bytes)
    pace.paused(0.0)
    left = (round(max(0, size_bytes - taken_per_s * second)) for second in range(seconds))
    return any(unsent and pace.is_too_slow(float(second), unsent) for second, unsent in enumerate(left))


def test_a_slow_network_may_take_a_short_answer_in_at_its_pace():
    assert not is_cut_off(100_000, 500)
    assert is_cut_off(100_000, 200)


def test_the_pace_grows_with_the_answer():
    for taken_per_s, cut_off in ((0, True), (750, True), (10_000, True), (15_000, False)):
        assert is_cut_off(LARGE, taken_per_s) is cut_off, taken_per_s


def test_a_pause_for_each_piece_does_not_begin_the_measurement_anew():
    pace, piece, now = ReadingPace(Limits(answer_timeout_s=ANSWER_S)), 65_536, 0.0
    pace.begin(LARGE, 0)
    for _ in range(3):
        pace.wrote(piece)
        pace.paused(now)
        now += 20.0  # less than a caller may wait with any answer
        if pace.is_too_slow(now, 0):
            return
        pace.resumed(now)
    raise AssertionError("a piece in 20 s is too slow for 4 MB")


def test_only_time_without_progress_of_the_caller_counts():
    pace = ReadingPace(Limits(answer_timeout_s=ANSWER_S))
    pace.begin(0, 0)
    for hour in range(10):  # a stream of events
        pace.wrote(100)
        assert not pace.is_too_slow(3600.0 * hour, 0)
    pace.paused(36_000.0)
    assert not pace.is_too_slow(36_029.0, 0)
    assert pace.is_too_slow(36_040.0, 0)


def test_unsent_bytes_of_an_earlier_answer_do_not_count():
    pace = ReadingPace(Limits(answer_timeout_s=ANSWER_S))
    pace.begin(1000, 60_000)
    pace.wrote(1000)
    pace.paused(0.0)
    assert pace.is_too_slow(ANSWER_S + 1, 61_000)
    assert not pace.is_too_slow(ANSWER_S + 1, 60_000)
