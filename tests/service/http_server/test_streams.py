"""Writes of an answer: a proxy sees all of a short one or nothing when the service is killed."""

from __future__ import annotations

import asyncio
from typing import Any

import uvicorn
from uvicorn.server import ServerState

from firstfix_service.http_server.protocol import LimitedHttpProtocol
from firstfix_service.http_server.streams import PIECE_BYTES, in_pieces
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
        config = uvicorn.Config(app, log_config=None, access_log=False, proxy_headers=False, lifespan="off")
        config.load()
        connections = Connections(Limits.of(Settings(store="memory://")), (), lambda why: None)
        protocol = LimitedHttpProtocol(config, ServerState(), {}, connections=connections)
        transport = Recorded()
        protocol.connection_made(transport)
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


def test_a_caller_is_told_to_continue_before_the_answer():
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


def test_others_have_their_turn_between_the_pieces_of_an_answer():
    async def exchange() -> list[int]:
        turns, seen = 0, []

        async def other() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        async def app(scope: Any, receive: Any, send: Any) -> None:
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": bytes(4 * PIECE_BYTES)})

        async def send(message: Any) -> None:
            seen.append(turns)

        begun: list[int] = []
        running = asyncio.create_task(other())
        await asyncio.sleep(0)
        await in_pieces(app, begun.append)({}, None, send)
        running.cancel()
        assert begun == [0], "of unknown length"
        return seen

    start, first, *others = asyncio.run(exchange())
    assert start == first, "the head and the first piece go out together"
    assert all(later > earlier for earlier, later in zip([first, *others], others, strict=False))
