"""Messages between the service and a worker, over real sockets: in pieces, too long, cut off."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix_service.query_workers.protocol import (
    INLINE_BYTES,
    MessageReader,
    message_of,
    reply_of,
    send_all,
)
from firstfix_service.query_workers.query import BodyFormat, Query, ServedVersion

FORMAT = BodyFormat.of("application/vnd.firstfix.xyz", None)


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    here, there = socket.socketpair()
    with here, there:
        yield here, there


def query(body: bytes) -> Query:
    versions = (ServedVersion("hall", "1" * 64, Path("/x")),)
    return Query(("hall",), LocalizeOptions(), FORMAT, body=body, versions=versions)


def received(reader: MessageReader, stream: socket.socket):
    while (message := reader.receive(stream)) is None:
        pass
    return message


def test_a_small_body_travels_with_its_query(ends):
    send_all(ends[0], message_of(query(b"123")))
    asked, inline, shared = received(MessageReader(), ends[1])
    assert (bytes(inline), shared) == (b"123", 0)
    assert asked.versions[0].map_id == "hall"
    assert asked.body == b"", "it is not sent twice"


def test_a_large_body_is_only_announced(ends):
    send_all(ends[0], message_of(query(bytes(INLINE_BYTES + 1))))
    _, inline, shared = received(MessageReader(), ends[1])
    assert (len(inline), shared) == (0, INLINE_BYTES + 1)


def test_a_message_comes_in_any_pieces_and_may_be_long(ends):
    reader = MessageReader()
    for length in (3, 400_000, 5):  # longer than the reader's room, and short again
        message = b"".join(map(bytes, reply_of(True, "x" * length)))
        for at in range(0, len(message), 50_000):
            ends[0].sendall(message[at : at + 50_000][:7])
            assert reader.receive(ends[1]) is None
            ends[0].sendall(message[at : at + 50_000][7:])
            last = reader.receive(ends[1])
        assert last is not None
        assert last[0] == (True, "x" * length)
        reader.forget()


def test_a_closed_end_is_told_from_an_idle_one(ends):
    ends[1].setblocking(False)
    with pytest.raises(BlockingIOError):
        MessageReader().receive(ends[1])
    ends[0].close()
    with pytest.raises(EOFError):
        MessageReader().receive(ends[1])


def test_a_message_beyond_all_measure_is_refused_before_it_takes_memory(ends):
    ends[0].sendall(struct.pack("<IIQ", 1 << 31, 0, 0))
    with pytest.raises(OSError, match="bytes"):
        MessageReader().receive(ends[1])
