"""Reader and writer of ROS messages, field by field: CDR (ROS 2) with its alignment, or ROS 1's packed form.

The reader is safe for untrusted input: it reads and allocates nothing beyond the end of the body.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NoReturn

from ..errors import MalformedData, UnsupportedFormat

_ENCAPSULATION_BYTES = 4
_BYTE_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}  # plain CDR: ROS 2 sends nothing else
_MAX_TRAILING_BYTES = 3  # some middlewares pad the message to a multiple of four
MAX_TEXT_BYTES = 1024  # of a frame or field name


class MessageReader:
    """Reads one serialised message from its beginning.

    Args:
        name: type of the message, for errors.
        body: the whole message.
        ros1: packed little-endian as in a ROS 1 bag, instead of CDR with its encapsulation.

    Raises:
        MalformedData: shorter than the encapsulation.
        UnsupportedFormat: an encapsulation other than plain CDR.
    """

    def __init__(self, name: str, body: bytes | memoryview, *, ros1: bool = False) -> None:
        self.name = name
        self.ros1 = ros1
        self._body = memoryview(body)
        self._start = 0 if ros1 else _ENCAPSULATION_BYTES
        self._place = self._start
        self._order = "<" if ros1 else self._byte_order()

    def _byte_order(self) -> str:
        if len(self._body) < _ENCAPSULATION_BYTES:
            self.fail(f"{len(self._body)} bytes are too few for a message")
        order = _BYTE_ORDERS.get(bytes(self._body[:2]))
        if order is None:
            raise UnsupportedFormat(
                f"{self.name}: the encapsulation 0x{bytes(self._body[:2]).hex()} is not plain CDR"
            )
        return order

    def fail(self, why: str) -> NoReturn:
        """Raise MalformedData with the message's name."""
        raise MalformedData(f"{self.name}: {why}")

    def number(self, code: str) -> int:
        """Read one integer, given by its struct code (``B``, ``i``, ``I``)."""
        (value,) = self._unpack(code, 1)
        return int(value)

    def floats(self, count: int) -> tuple[float, ...]:
        """Read float64 values of a fixed number."""
        return self._unpack("d", count)

    def flag(self) -> bool:
        """Read a boolean."""
        value = self.number("B")
        if value > 1:
            self.fail(f"a boolean must be 0 or 1, not {value}")
        return bool(value)

    def text(self) -> str:
        """Read a string of up to MAX_TEXT_BYTES."""
        length = self.number("I")
        if length > MAX_TEXT_BYTES:
            self.fail(f"a text of {length} bytes, the limit is {MAX_TEXT_BYTES}")
        raw = bytes(self._take(length))
        if not self.ros1 and raw:
            if raw[-1]:
                self.fail("a text does not end with a zero byte")
            raw = raw[:-1]
        try:
            return raw.decode()
        except UnicodeDecodeError:
            self.fail("a text is not UTF-8")

    def count(self, most: int, what: str) -> int:
        """Read the length of a sequence.

        Args:
            most: its limit.
            what: name of the elements, for errors.
        """
        count = self.number("I")
        if count > most:
            self.fail(f"{count} {what}, the limit is {most}")
        return count

    def octets(self) -> memoryview:
        """Read a sequence of bytes as a view. Its length is compared with the rest of the body."""
        return self._take(self.number("I"))

    def end(self) -> None:
        """Check that only padding follows."""
        left = len(self._body) - self._place
        if left > (0 if self.ros1 else _MAX_TRAILING_BYTES):
            self.fail(f"{left} bytes follow the message")

    def _unpack(self, code: str, count: int) -> tuple[float, ...]:
        size = struct.calcsize("=" + code)
        if not self.ros1:
            self._place += -(self._place - self._start) % size
        return struct.unpack(f"{self._order}{count}{code}", self._take(size * count))

    def _take(self, size: int) -> memoryview:
        end = self._place + size
        if end > len(self._body):
            self.fail(f"the message is cut off: {max(0, len(self._body) - self._place)} of {size} bytes")
        taken = self._body[self._place : end]
        self._place = end
        return taken


class CdrWriter:
    """Writes one message as little-endian CDR with its encapsulation."""

    def __init__(self) -> None:
        self._parts = bytearray(b"\x00\x01\x00\x00")

    def numbers(self, code: str, values: Sequence[float]) -> None:
        """Write values of one struct code, aligned."""
        size = struct.calcsize("=" + code)
        self._parts += bytes(-(len(self._parts) - _ENCAPSULATION_BYTES) % size)
        self._parts += struct.pack(f"<{len(values)}{code}", *values)

    def text(self, text: str) -> None:
        """Write a string."""
        raw = text.encode() + b"\0"
        self.numbers("I", [len(raw)])
        self._parts += raw

    def bytes(self) -> bytes:
        """The message."""
        return bytes(self._parts)
