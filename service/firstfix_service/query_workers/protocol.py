"""Messages of queries and replies between the service and a worker process, over a stream socket.

    offset  type   field
         0  u32    length of the pickled object
         4  u32    length of the body that follows it; 0: none
         8  u64    length of the body in the worker's ``BodyMemory``; 0: none

A small body follows in the message itself: a copy through the socket is as quick as shared memory then. There
is one message under way at a time, so a receiver reads all that has come.
"""

from __future__ import annotations

import pickle
import socket
import struct
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from firstfix.formats.point_cloud import Body

from .query import Query

INLINE_BYTES = 32 << 10
_HEAD = struct.Struct("<IIQ")
_MAX_MESSAGE_BYTES = 1 << 30
_ROOM_BYTES = 128 << 10


def message_of(query: Query) -> list[Body]:
    """Returns the parts of a query's message. A body over INLINE_BYTES is only announced."""
    size = len(query.body)
    pickled = pickle.dumps(replace(query, body=b""), pickle.HIGHEST_PROTOCOL)
    if size > INLINE_BYTES:
        return [_HEAD.pack(len(pickled), 0, size), pickled]
    return [_HEAD.pack(len(pickled), size, 0), pickled, query.body]


def reply_of(good: bool, value: object) -> list[Body]:
    """Returns the parts of a reply's message.

    Args:
        good: the value is the result; otherwise it is the error.
    """
    pickled = pickle.dumps((good, value), pickle.HIGHEST_PROTOCOL)
    return [_HEAD.pack(len(pickled), 0, 0), pickled]


def send_all(stream: socket.socket, parts: Sequence[Body]) -> None:
    """Sends a message through a blocking socket."""
    sent, size = stream.sendmsg(parts), sum(map(len, parts))
    if sent < size:
        stream.sendall(b"".join(parts)[sent:])


class MessageReader:
    """Receives messages from a stream socket, blocking or not."""

    def __init__(self) -> None:
        self._room = bytearray(_ROOM_BYTES)
        self._have = 0

    def receive(self, stream: socket.socket) -> tuple[Any, memoryview, int] | None:
        """Reads once.

        Returns:
            The object, its body, which the next call overwrites, and the length of its body in the worker's
            memory. None if the message is not complete yet.

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
        pickled, inline, shared = _HEAD.unpack_from(self._room)
        size = _HEAD.size + pickled + inline
        if self._have < size:
            if size > _MAX_MESSAGE_BYTES:
                raise OSError(f"a message of {size} bytes")
            if size > len(self._room):
                self._room = self._room[: self._have] + bytes(size - self._have)
            return None
        self._have = 0
        message = memoryview(self._room)[_HEAD.size : size]
        return pickle.loads(message[:pickled]), message[pickled:], shared

    def forget(self) -> None:
        """Gives back the room of a long message, once it has been used."""
        if len(self._room) > _ROOM_BYTES:
            self._room = bytearray(_ROOM_BYTES)
