"""Messages between the service and a worker over real sockets, and bodies through shared memory."""

from __future__ import annotations

import os
import socket
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from firstfix.answer.localization import Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import TooLarge
from firstfix_service.auth.principal import Principal
from firstfix_service.query_workers.answer_form import AnswerForm
from firstfix_service.query_workers.protocol import (
    INLINE_BYTES,
    KEPT_BYTES,
    BodyMemory,
    MessageReader,
    mapped_bodies,
    message_of,
    reply_of,
    send_all,
)
from firstfix_service.query_workers.query import AsGiven, BodyFormat, EncodedAnswer, Query, ServedVersion

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
    send_all(ends[0], message_of(query(b"123"), 5))
    asked, inline, shared, number = received(MessageReader(), ends[1])
    assert (bytes(inline), shared, number) == (b"123", 0, 5)
    assert asked.versions[0].map_id == "hall"
    assert asked.body == b"", "it is not sent twice"


def test_what_a_head_means_travels_once_packed_and_arrives_whole(ends):
    options = {"prior": "1,2,3,4", "max_candidates": "7", "deadline_ms": "500"}
    given = AsGiven(("hall",), "application/vnd.firstfix.xyz", "gzip", options, AnswerForm(geographic=True))
    first, second = (Query.read(given, Principal("robot"), tuple, arrived) for arrived in (10.0, 20.0))
    assert first.packed is second.packed
    assert (first.deadline, second.deadline) == (10.5, 20.5)
    versions = (ServedVersion("hall", "1" * 64, Path("/x"), provisional=True),)
    send_all(ends[0], message_of(second.filled(versions=versions, waits_ms={"queue": 1.5}, chosen_of=3), 1))
    asked, *_ = received(MessageReader(), ends[1])
    assert asked.options.to_strings() == second.options.to_strings()
    assert asked.options.prior is not None
    assert (asked.body_format.decompress, asked.form) == (second.body_format.decompress, given.form)
    assert (asked.map_ids, asked.versions, asked.deadline) == (("hall",), versions, 20.5)
    assert (dict(asked.waits_ms), asked.chosen_of) == ({"queue": 1.5}, 3)
    assert (asked.caller.name, asked.given.options) == ("", {}), "a worker need not know who asks"


def test_an_answer_arrives_whole(ends):
    answer = EncodedAnswer(
        Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,), 0.25, "hall", "1" * 64, {"decode": 0.5}, b"{}", b"pose"
    )
    send_all(ends[0], reply_of(True, answer))
    (good, found), *_ = received(MessageReader(), ends[1])
    assert (good, found) == (True, answer)
    assert found.verdict is Verdict.REJECTED


def test_a_large_body_is_only_announced(ends):
    send_all(ends[0], message_of(query(bytes(INLINE_BYTES + 1)), 2**63))
    _, inline, shared, number = received(MessageReader(), ends[1])
    assert (len(inline), shared, number) == (0, INLINE_BYTES + 1, 2**63)


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


def test_a_closed_end_and_an_idle_one_are_distinguished(ends):
    ends[1].setblocking(False)
    with pytest.raises(BlockingIOError):
        MessageReader().receive(ends[1])
    ends[0].close()
    with pytest.raises(EOFError):
        MessageReader().receive(ends[1])


def test_an_oversized_message_is_refused_before_it_takes_memory(ends):
    ends[0].sendall(struct.pack("<IIQQ", 1 << 31, 0, 0, 1))
    with pytest.raises(OSError, match="bytes"):
        MessageReader().receive(ends[1])


CAPACITY = 16 << 20


@pytest.fixture
def memory():
    memory = BodyMemory(CAPACITY)
    yield memory
    memory.close()


def held_bytes(memory: BodyMemory) -> int:
    return os.fstat(memory.descriptor).st_blocks * 512


@pytest.mark.skipif(
    sys.platform != "linux", reason="needs Linux, which has files in memory: run in a container"
)
def test_the_worker_can_read_and_not_write(memory: BodyMemory):
    cancelled, seen = mapped_bodies(memory.descriptor, CAPACITY)
    memory.write(b"a body")
    assert seen[:6] == b"a body"
    memory.write(memoryview(b"more"))
    assert seen[:4] == b"more"
    assert bytes(cancelled) == bytes(8)
    memory.cancel(2**63 + 1)
    assert (cancelled.cast("Q")[0], bytes(seen[:4])) == (2**63 + 1, b"more")
    for part in (cancelled, seen):
        with pytest.raises(TypeError):
            part[0] = 0


@pytest.mark.skipif(
    sys.platform != "linux", reason="needs Linux, which has files in memory: run in a container"
)
def test_a_body_over_the_capacity_is_refused(memory: BodyMemory):
    with pytest.raises(TooLarge):
        memory.write(bytes(CAPACITY + 1))


@pytest.mark.skipif(
    sys.platform != "linux", reason="needs Linux, which has files in memory: run in a container"
)
def test_only_written_bytes_take_memory_and_a_large_body_frees_its_own(memory: BodyMemory):
    assert held_bytes(memory) == 0
    memory.write(bytes(100_000))
    assert 0 < held_bytes(memory) < 200_000
    memory.trim(100_000)
    memory.write(bytes(CAPACITY))
    assert held_bytes(memory) == CAPACITY
    memory.trim(CAPACITY)
    assert held_bytes(memory) == KEPT_BYTES


@pytest.mark.skipif(
    sys.platform != "linux", reason="needs Linux, which has files in memory: run in a container"
)
def test_the_size_of_the_memory_cannot_be_changed(memory: BodyMemory):
    """Otherwise a worker could take away the pages that the service writes to."""
    other = os.open(f"/proc/self/fd/{memory.descriptor}", os.O_RDWR)
    try:
        for size in (0, 2 * CAPACITY):
            with pytest.raises(PermissionError):
                os.truncate(f"/proc/self/fd/{other}", size)
    finally:
        os.close(other)


@pytest.mark.skipif(
    sys.platform != "linux", reason="needs Linux, which has files in memory: run in a container"
)
def test_closing_leaves_no_file_and_no_mapping():
    before = _bodies_mapped()
    memory = BodyMemory(CAPACITY)
    assert _bodies_mapped() == before + 1
    number = memory.descriptor
    memory.close()
    assert _bodies_mapped() == before
    assert not Path(f"/proc/self/fd/{number}").exists()


def _bodies_mapped() -> int:
    return Path("/proc/self/maps").read_text().count("firstfix-bodies")
