"""Reader of one MCAP file: of any profile and any mixture of encodings, complete or cut off.

Who wants the messages of one topic does not depend on the others: JSON or protobuf beside ROS is no damage.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Set
from pathlib import Path

from . import mcap_records as records
from .mcap_index import chunk_body, chunk_messages, index_of
from .mcap_records import Channel, Chunk, read_exactly
from .messages import RawMessage, Topic, ros2_type
from .time_order import Part, in_time_order


class McapFile:
    """See ``Storage``."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        try:
            self._index = index_of(self._file)
        except BaseException:
            self._file.close()
            raise
        counts: Counter[tuple[str, str, str]] = Counter()
        for number, count in self._index.counts.items():
            if number not in self._index.channels:
                records.fail(f"messages of a channel {number} that is not there")
            channel = self._index.channels[number]
            counts[channel.topic, ros2_type(channel.type), channel.encoding] += count
        self.topics = [Topic(*key, count) for key, count in sorted(counts.items()) if count]
        self.start_ns = self._index.start_ns
        self.notes = [] if self._index.cut_at is None else [self._cut_note(path, self._index.cut_at)]

    def _cut_note(self, path: Path, cut_at: int) -> str:
        return (
            f"{path.name} was cut off while it was recorded: {cut_at} of its {path.stat().st_size} bytes are "
            f"complete, and were read: {self._index.counts.total()} messages"
        )

    def schema(self, topic: Topic) -> bytes:
        """The definition of a topic's messages, as the recorder wrote it."""
        return next((c.schema for c in self._index.channels.values() if _is_of(c, topic)), b"")

    def messages(self, topics: Set[str], start_ns: int | None) -> Iterator[RawMessage]:
        """Yield the messages of these topics in the order of recording, from a time on."""
        channels = {number: c for number, c in self._index.channels.items() if c.topic in topics}
        if not channels:
            return
        start_ns = start_ns or 0
        parts = [self._part(chunk, frozenset(channels), start_ns) for chunk in self._index.chunks]
        parts.append(Part(self._index.start_ns, lambda: self._loose(frozenset(channels), start_ns)))
        for time_ns, (number, body) in in_time_order(part for part in parts if part is not None):
            channel = channels[number]
            yield RawMessage(channel.topic, time_ns, body, ros2_type(channel.type), channel.encoding)

    def _part(
        self, chunk: Chunk, channels: frozenset[int], start_ns: int
    ) -> Part[tuple[int, bytes | memoryview]] | None:
        if chunk.end_ns < start_ns or (chunk.channels and not chunk.channels & channels):
            return None
        return Part(chunk.start_ns, lambda: self._of_chunk(chunk, channels, start_ns))

    def _of_chunk(
        self, chunk: Chunk, channels: frozenset[int], start_ns: int
    ) -> Iterator[tuple[int, tuple[int, bytes | memoryview]]]:
        body = chunk_body(self._file, chunk.place)
        for time_ns, channel, begin, end in chunk_messages(body, channels, start_ns):
            message = body[
                begin:end
            ]  # a copy costs more than the reading, but a small one would keep the chunk
            yield time_ns, (channel, message if 2 * len(message) > len(body) else bytes(message))

    def _loose(
        self, channels: frozenset[int], start_ns: int
    ) -> Iterator[tuple[int, tuple[int, bytes | memoryview]]]:
        for time_ns, channel, place, size in sorted(self._index.loose):
            if channel in channels and time_ns >= start_ns:
                self._file.seek(place)
                yield time_ns, (channel, read_exactly(self._file, size))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _is_of(channel: Channel, topic: Topic) -> bool:
    return (channel.topic, ros2_type(channel.type), channel.encoding) == (
        topic.name,
        topic.type,
        topic.encoding,
    )
