"""Protocol between the service and a worker process: messages over a stream socket, and shared memory.

    offset  type   field
         0  u32    length of the pickled object
         4  u32    length of the body that follows it; 0: none
         8  u64    length of the body in the worker's ``BodyMemory``; 0: none
        16  u64    number of the query, from 1; 0 in a reply

A small body follows in the message itself: a copy through the socket is as quick as shared memory then. There
is one message under way at a time, so a receiver reads all that has come.

A file without a name holds the memory for long bodies: the service writes, the worker reads. In its first
page is the number of the query that was cancelled last, so that a late cancellation does not end the next
one. The kernel frees the file as soon as neither process has it open, however they end. Each worker has
memory of its own: it never sees a body of another worker's queries.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import pickle
import socket
import struct
import sys
import tempfile
from collections.abc import Callable, Sequence
from typing import Any

from firstfix.errors import TooLarge
from firstfix.formats.point_cloud import Body

from .look import Asked
from .query import EncodedAnswer, Query

LOAD, WARM, DROP, HELLO, TAKE = "load", "warm", "drop", "hello", "take"  # over the other socket, for control
QUERY, ANSWER, OTHER = "query", "answer", "other"  # of a pickled object: a plain form, or any other object
INLINE_BYTES = 32 << 10
KEPT_BYTES = 4 << 20  # of memory, after a query; larger bodies are rare
_HEAD = struct.Struct("<IIQQ")
_CANCELLED = struct.Struct("Q")  # native: written at once
_BODIES_AT = mmap.PAGESIZE
_MAX_MESSAGE_BYTES = 1 << 30
_ROOM_BYTES = 128 << 10


_READ: dict[str, Callable[..., Any]] = {
    QUERY: Query.of_plain,
    ANSWER: lambda *plain: (True, EncodedAnswer.of_plain(*plain)),
    OTHER: lambda told: told,
}


def message_of(asked: Asked, number: int) -> list[Body]:
    """The parts of the message of a query or a look. A body over INLINE_BYTES is only announced."""
    size = len(asked.body)
    told = (QUERY, *asked.plain) if isinstance(asked, Query) else (OTHER, asked)
    pickled = pickle.dumps(told, pickle.HIGHEST_PROTOCOL)
    if size > INLINE_BYTES:
        return [_HEAD.pack(len(pickled), 0, size, number), pickled]
    return [_HEAD.pack(len(pickled), size, 0, number), pickled, asked.body]


def reply_of(good: bool, value: object) -> list[Body]:
    """The parts of a reply's message.

    Args:
        good: the value is the result; otherwise it is the error.
    """
    told = (ANSWER, *value.plain) if isinstance(value, EncodedAnswer) else (OTHER, (good, value))
    pickled = pickle.dumps(told, pickle.HIGHEST_PROTOCOL)
    return [_HEAD.pack(len(pickled), 0, 0, 0), pickled]


def send_all(stream: socket.socket, parts: Sequence[Body]) -> None:
    """Send a message through a blocking socket."""
    sent, size = stream.sendmsg(parts), sum(map(len, parts))
    if sent < size:
        stream.sendall(b"".join(parts)[sent:])


class MessageReader:
    """Receives messages from a stream socket, blocking or not."""

    def __init__(self) -> None:
        self._room = bytearray(_ROOM_BYTES)
        self._have = 0

    def receive(self, stream: socket.socket) -> tuple[Any, memoryview, int, int] | None:
        """Read once.

        Returns:
            The object, its body, which the next call overwrites, the length of its body in the worker's
            memory, and the number of the query. None if the message is not complete yet.

        Raises:
            EOFError: the other end was closed.
            OSError: it cannot be read, or it is too long.
            BlockingIOError: nothing has come.
        """
        if (count := stream.recv_into(memoryview(self._room)[self._have :])) == 0:
            raise EOFError
        self._have += count
        if self._have < _HEAD.size:
            return None
        pickled, inline, shared, number = _HEAD.unpack_from(self._room)
        size = _HEAD.size + pickled + inline
        if self._have < size:
            if size > _MAX_MESSAGE_BYTES:
                raise OSError(f"a message of {size} bytes")
            if size > len(self._room):
                self._room = self._room[: self._have] + bytes(size - self._have)
            return None
        self._have = 0
        message = memoryview(self._room)[_HEAD.size : size]
        kind, *told = pickle.loads(message[:pickled])
        return _READ[kind](*told), message[pickled:], shared, number

    def forget(self) -> None:
        """Give back the room of a long message, once it has been used."""
        if len(self._room) > _ROOM_BYTES:
            self._room = bytearray(_ROOM_BYTES)


class BodyMemory:
    """The service's end. For one query at a time.

    Args:
        capacity_bytes: largest body. Only the part that bodies have filled takes memory.
    """

    def __init__(self, capacity_bytes: int) -> None:
        self._capacity_bytes = capacity_bytes
        self.descriptor = _nameless_file(_BODIES_AT + capacity_bytes)
        self._map = mmap.mmap(self.descriptor, _BODIES_AT + capacity_bytes)

    def write(self, body: Body) -> None:
        """Copy a body to the beginning.

        Raises:
            TooLarge: it is larger than the capacity.
        """
        if len(body) > self._capacity_bytes:
            raise TooLarge(f"the body has {len(body)} bytes, the limit is {self._capacity_bytes}")
        self._map[_BODIES_AT : _BODIES_AT + len(body)] = body

    def cancel(self, number: int) -> None:
        """Let the query of a number end."""
        _CANCELLED.pack_into(self._map, 0, number)

    def trim(self, used_bytes: int) -> None:
        """Give back the memory of a large body, once its query has ended."""
        if used_bytes > KEPT_BYTES and sys.platform == "linux":
            kept = _BODIES_AT + KEPT_BYTES
            self._map.madvise(mmap.MADV_REMOVE, kept, len(self._map) - kept)

    def close(self) -> None:
        """Give the memory back, apart from the worker's own mapping."""
        self._map.close()
        os.close(self.descriptor)


def mapped_bodies(descriptor: int, capacity_bytes: int) -> tuple[memoryview, memoryview]:
    """The worker's view of the memory, read-only: the word of the cancelled query, and the bodies."""
    mapped = memoryview(mmap.mmap(descriptor, _BODIES_AT + capacity_bytes, access=mmap.ACCESS_READ))
    return mapped[: _CANCELLED.size], mapped[_BODIES_AT:]


def _nameless_file(size: int) -> int:
    if sys.platform == "linux":
        descriptor = os.memfd_create("firstfix-bodies", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(descriptor, size)
        # A worker cannot cut the file off: the service would die of its next write.
        fcntl.fcntl(
            descriptor, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
        )
        return descriptor
    with tempfile.TemporaryFile() as file:
        file.truncate(size)
        return os.dup(file.fileno())
