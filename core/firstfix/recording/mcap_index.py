"""Index of the messages of an MCAP file: by its summary, or, without one, by a walk through its records."""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO
from zlib import crc32

from ..errors import InputError, MalformedData
from . import mcap_records as records
from .compression import unpack_chunk
from .mcap_records import Channel, Chunk, Declarations, Fields, fail, read_exactly


@dataclass
class McapIndex:
    """Places of the messages.

    Attributes:
        channels: by their numbers.
        counts: of the messages of each channel.
        chunks: in the file's order.
        loose: messages outside of chunks: log time, channel, place and size of the message's bytes.
        start_ns: time of the first message.
        cut_at: first byte that is not part of a complete record, where a recording was cut off.
    """

    channels: dict[int, Channel]
    counts: Counter[int] = field(default_factory=Counter)
    chunks: list[Chunk] = field(default_factory=list)
    loose: list[tuple[int, int, int, int]] = field(default_factory=list)
    start_ns: int = 0
    cut_at: int | None = None


def index_of(file: BinaryIO) -> McapIndex:
    """Find the messages of an open file.

    A file that was cut off is read to its last complete record. The walk unpacks every chunk once: chunks
    alone name their channels then.

    Raises:
        MalformedData: no MCAP file, or nothing complete is in it.
        TooLarge: a record is over its limit.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    if file.read(len(records.MAGIC)) != records.MAGIC:
        fail("the file does not begin as an MCAP file")
    return _by_summary(file, size) or _by_walk(file, size)


def _by_summary(file: BinaryIO, size: int) -> McapIndex | None:
    """The index that a recorder writes at the end; None if it is not there, or says not enough."""
    file.seek(max(0, size - records.FOOTER_BYTES))
    footer = file.read()
    if len(footer) < records.FOOTER_BYTES or not footer.endswith(records.MAGIC):
        return None
    opcode, length = records.HEAD.unpack_from(footer)
    (start,) = struct.unpack_from("<Q", footer, records.HEAD.size)
    if (opcode, length) != (records.FOOTER, 20) or start > size - records.FOOTER_BYTES:
        fail("its footer is damaged")
    if not start:
        return None
    file.seek(start)
    body = memoryview(read_exactly(file, size - records.FOOTER_BYTES - start))
    declared, index, chunk_count, total = Declarations(), None, 0, 0
    chunks, indexed = [], []
    for opcode, place, end in _records_in(body):
        declared.add(opcode, body[place:end])
        fields = Fields(body[place:end])
        if opcode == records.CHUNK_INDEX:
            chunk, count = _indexed(fields)
            chunks.append(chunk)
            indexed.append(count)
        elif opcode == records.STATISTICS:
            total, *_, chunk_count, start_ns, _ = fields.numbers("QHIIIIQQ")
            counts = Counter(dict(fields.pairs()))
            index = McapIndex(declared.channels, counts, chunks, start_ns=start_ns)
    if index is None or not set(index.counts) <= set(declared.channels):
        return None
    if len(chunks) != chunk_count or index.counts.total() != total:  # an empty map of counts: not known
        return None
    known = [count for count in indexed if count is not None]
    if len(known) == len(indexed) and sum(known) != total:  # some messages are outside of the chunks
        return None
    return index


def _indexed(fields: Fields) -> tuple[Chunk, int | None]:
    """A chunk, and the number of its messages; None: its messages have no index."""
    start_ns, end_ns, place, _ = fields.numbers("QQQQ")
    channels = [channel for channel, _ in fields.pairs()]
    (index_bytes,) = fields.numbers("Q")
    head_bytes, entry_bytes = records.HEAD.size + 6, 16  # channel and size of the array; time and place
    count = (index_bytes - head_bytes * len(channels)) // entry_bytes if channels else None
    return Chunk(start_ns, end_ns, place + records.HEAD.size, frozenset(channels)), count


def _records_in(body: memoryview) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of each record of a chunk or a summary."""
    place, size = 0, len(body)
    while place < size:
        if place + records.HEAD.size > size:
            fail("a record is cut off")
        opcode, length = records.HEAD.unpack_from(body, place)
        place += records.HEAD.size
        if length > size - place:
            fail("a record is cut off")
        if not opcode:
            fail("a record without a kind")  # a small file can unpack to millions of such
        yield opcode, place, place + length
        place += length


def _by_walk(file: BinaryIO, size: int) -> McapIndex:
    declared = Declarations()
    index = McapIndex(declared.channels)
    times: list[int] = []
    place = len(records.MAGIC)
    try:
        while True:
            file.seek(place)
            opcode, length = records.HEAD.unpack(read_exactly(file, records.HEAD.size))
            begin = place + records.HEAD.size
            if opcode in (records.DATA_END, records.FOOTER):
                break
            if not opcode or length > size - begin:
                fail("the file ends within a record")
            if opcode == records.CHUNK:
                times += _walk_chunk(file, begin, declared, index)
            elif opcode == records.MESSAGE:
                channel, _, time_ns, _ = records.MESSAGE_HEAD.unpack(
                    read_exactly(file, records.MESSAGE_HEAD.size)
                )
                head = records.MESSAGE_HEAD.size
                index.loose.append((time_ns, channel, begin + head, length - head))
                index.counts[channel] += 1
                times.append(time_ns)
            elif opcode in (records.SCHEMA, records.CHANNEL):
                declared.add(opcode, read_exactly(file, length))
            place = begin + length
    except (InputError, struct.error):
        if not times:
            raise
        index.cut_at = place
    index.start_ns = min(times, default=0)
    return index


def _walk_chunk(file: BinaryIO, place: int, declared: Declarations, index: McapIndex) -> list[int]:
    """Take a chunk into the index. Returns the times of its messages."""
    times, counts = [], Counter[int]()
    body = chunk_body(file, place)
    for opcode, begin, end in _records_in(body):
        if opcode == records.MESSAGE:
            channel, _, time_ns, _ = _message_head(body, begin, end)
            counts[channel] += 1
            times.append(time_ns)
        else:
            declared.add(opcode, body[begin:end])
    if times:
        index.chunks.append(Chunk(min(times), max(times), place, frozenset(counts)))
        index.counts += counts
    return times


def chunk_body(file: BinaryIO, place: int) -> memoryview:
    """The unpacked records of a chunk.

    Raises:
        MalformedData: damaged or cut off.
        TooLarge: over MAX_CHUNK_BYTES, packed or not.
    """
    file.seek(place)
    _, _, size, crc, name_bytes = struct.unpack("<QQQII", read_exactly(file, 32))
    name = read_exactly(file, name_bytes).decode()
    (packed_bytes,) = struct.unpack("<Q", read_exactly(file, 8))
    body = unpack_chunk(name, read_exactly(file, packed_bytes), size)
    if len(body) != size or (crc and crc32(body) != crc):
        raise MalformedData("mcap: a chunk has not the size or the checksum that it declares")
    return memoryview(body)


def chunk_messages(
    body: memoryview, channels: frozenset[int], start_ns: int
) -> list[tuple[int, int, int, int]]:
    """The messages of some channels in a chunk, by time: log time, channel, begin and end of its bytes."""
    found = []
    for opcode, begin, end in _records_in(body):
        if opcode == records.MESSAGE:
            channel, _, time_ns, _ = _message_head(body, begin, end)
            if channel in channels and time_ns >= start_ns:
                found.append((time_ns, channel, begin + records.MESSAGE_HEAD.size, end))
    return sorted(found, key=lambda one: one[0])


def _message_head(body: memoryview, begin: int, end: int) -> tuple[int, int, int, int]:
    if end - begin < records.MESSAGE_HEAD.size:
        fail("a message is cut off")
    head: tuple[int, int, int, int] = records.MESSAGE_HEAD.unpack_from(body, begin)
    return head
