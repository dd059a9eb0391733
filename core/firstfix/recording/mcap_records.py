"""Records of MCAP (https://mcap.dev/spec), read field by field: none is read beyond its end."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import BinaryIO, NoReturn

from ..errors import MalformedData, TooLarge
from .messages import MAX_CHUNK_BYTES

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, DATA_END = 0x0B, 0x0F
HEAD = struct.Struct("<BQ")  # opcode and length of a record
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_PAIR = struct.Struct("<HQ")
FOOTER_BYTES = HEAD.size + 20 + len(MAGIC)


class Fields:
    """The fields of one record."""

    def __init__(self, body: bytes | memoryview) -> None:
        self._body = memoryview(body)
        self._place = 0

    def numbers(self, code: str) -> tuple[int, ...]:
        """Read numbers, given by struct codes."""
        form = struct.Struct("<" + code)
        return form.unpack(self._take(form.size))

    def text(self) -> str:
        """Read a string."""
        return bytes(self.octets()).decode()

    def octets(self) -> memoryview:
        """Read bytes, or a map or an array, with the length before them."""
        return self._take(self.numbers("I")[0])

    def pairs(self) -> list[tuple[int, int]]:
        """Read a map of channels to numbers of eight bytes."""
        octets = self.octets()
        if len(octets) % _PAIR.size:
            fail("a record is cut off")
        return list(_PAIR.iter_unpack(octets))

    def _take(self, size: int) -> memoryview:
        taken = self._body[self._place : self._place + size]
        if len(taken) != size:
            fail("a record is cut off")
        self._place += size
        return taken


@dataclass(frozen=True)
class Channel:
    """Messages of one topic and type, as a file declares them."""

    topic: str
    type: str
    encoding: str
    schema: bytes


@dataclass(frozen=True)
class Chunk:
    """A chunk of messages in the file.

    Attributes:
        place: of its record's fields.
        channels: those that have messages in it; empty: not known.
    """

    start_ns: int
    end_ns: int
    place: int
    channels: frozenset[int]


class Declarations:
    """The schemas and channels of a file, as their records come."""

    def __init__(self) -> None:
        self._schemas: dict[int, tuple[str, bytes]] = {0: ("", b"")}
        self.channels: dict[int, Channel] = {}

    def add(self, opcode: int, body: bytes | memoryview) -> None:
        """Take a record; others than SCHEMA and CHANNEL are ignored."""
        fields = Fields(body)
        if opcode == SCHEMA:
            (number,) = fields.numbers("H")
            name, _ = fields.text(), fields.text()
            self._schemas[number] = (name, bytes(fields.octets()))
        elif opcode == CHANNEL:
            number, schema = fields.numbers("HH")
            if schema not in self._schemas:
                fail(f"the channel {number} has a schema {schema} that is not there")
            self.channels.setdefault(
                number,
                Channel(fields.text(), self._schemas[schema][0], fields.text(), self._schemas[schema][1]),
            )


def fail(why: str) -> NoReturn:
    """Raise MalformedData."""
    raise MalformedData(f"mcap: {why}")


def read_exactly(file: BinaryIO, size: int) -> bytes:
    """Read bytes of a record.

    Raises:
        MalformedData: the file ends before.
        TooLarge: over MAX_CHUNK_BYTES.
    """
    if size > MAX_CHUNK_BYTES:
        raise TooLarge(f"mcap: a record has {size} bytes, the limit is {MAX_CHUNK_BYTES}")
    body = file.read(size)
    if len(body) != size:
        fail("the file ends within a record")
    return body
