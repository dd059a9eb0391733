"""Reader of one ROS 1 bag, by rosbags."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Set
from pathlib import Path

from ..errors import MalformedData
from .compression import limit_ros1_chunks
from .messages import ROS1, RawMessage, Topic, ros2_type


class Ros1File:
    """See ``Storage``."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag1 import Reader, ReaderError

        limit_ros1_chunks()
        self._reader = Reader(path)
        try:
            self._reader.open()
        except ReaderError as error:
            if "index" not in str(error):
                raise
            raise MalformedData(
                "its recorder ended before it wrote the index: "
                f"`rosbag reindex {path.name}` of ROS 1 writes it"
            ) from error
        counts: Counter[tuple[str, str]] = Counter()
        for connection in self._reader.connections:
            counts[connection.topic, ros2_type(connection.msgtype)] += connection.msgcount
        self.topics = [Topic(*key, ROS1, count) for key, count in sorted(counts.items()) if count]
        self.start_ns = int(self._reader.start_time)
        self.notes: list[str] = []

    def messages(self, topics: Set[str], start_ns: int | None) -> Iterator[RawMessage]:
        """Yield the messages of these topics in the order of recording, from a time on."""
        wanted = [connection for connection in self._reader.connections if connection.topic in topics]
        if wanted:
            for connection, time_ns, body in self._reader.messages(wanted, start_ns):
                yield RawMessage(connection.topic, time_ns, bytes(body), ros2_type(connection.msgtype), ROS1)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
