"""Reader of bags without ROS: ROS 1 files, ROS 2 folders, sqlite3 and mcap files, compressed or not.

One message is in memory at a time, or the messages of one chunk. For local files only: rosbags trusts the
counts and places that a bag declares.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import FirstfixError, InputError, InvalidOption, MalformedData, NotFound, UnsupportedFormat
from . import point_cloud2
from .bag_compression import limit_chunks, unpack_files, unpack_message

_ENDINGS = (".bag", ".db3", ".mcap", ".db3.zstd", ".mcap.zstd")


@dataclass(frozen=True)
class RawMessage:
    """A serialised message of a bag.

    Attributes:
        time_ns: time of recording.
        body: ROS 1 or CDR, see ``Bag.ros1``.
    """

    topic: str
    time_ns: int
    body: bytes


class Bag:
    """An open bag, see ``open_bag``.

    Attributes:
        ros1: messages are serialised as in ROS 1, otherwise as CDR.
    """

    def __init__(self, path: Path, reader: Any, *, ros1: bool) -> None:
        self.path = path
        self.ros1 = ros1
        self._reader = reader

    @property
    def start_ns(self) -> int:
        """Time of the first message."""
        return int(self._reader.start_time)

    def topics(self, message_type: str) -> list[str]:
        """The sorted names of the topics of one type that have messages."""
        return sorted({c.topic for c in self._reader.connections if c.msgtype == message_type and c.msgcount})

    def cloud_topic(self, wanted: str | None) -> str:
        """The topic to replay: the wanted one, or the only one with clouds.

        Raises:
            NotFound: the wanted topic, or every topic, has no clouds.
            InvalidOption: several topics have clouds, and no topic is wanted.
        """
        topics = self.topics(point_cloud2.TYPE)
        if wanted is not None:
            self.check_topic(wanted, point_cloud2.TYPE)
            return wanted
        if not topics:
            raise NotFound(f"{self.path}: no topic has messages of the type {point_cloud2.TYPE}")
        if len(topics) > 1:
            raise InvalidOption(f"{self.path}: several topics have clouds, choose one: {', '.join(topics)}")
        return topics[0]

    def check_topic(self, topic: str, message_type: str) -> None:
        """Check that a topic has messages of a type.

        Raises:
            NotFound: it has none; the error names the topics that have.
        """
        topics = self.topics(message_type)
        if topic not in topics:
            raise NotFound(
                f"{self.path}: {topic} has no {message_type}; topics that have: {', '.join(topics) or 'none'}"
            )

    def messages(self, topics: list[str], start_ns: int | None = None) -> Iterator[RawMessage]:
        """Yield the messages in the order of recording.

        Raises:
            MalformedData: the bag is damaged.
            TooLarge: a message or a chunk of messages is over its limit when it is unpacked.
        """
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        messages = self._reader.messages(connections=connections, start=start_ns)
        while True:
            with _damage_named(self.path):
                found = next(messages, None)
            if found is None:
                return
            connection, time_ns, body = found
            if not self.ros1:
                body = self._unpacked(connection.topic, time_ns, body)
            yield RawMessage(connection.topic, time_ns, bytes(body))

    def _unpacked(self, topic: str, time_ns: int, body: bytes) -> bytes:
        try:
            return unpack_message(body)
        except InputError as error:
            raise type(error)(f"{self.path}: the message of {topic} at {time_ns} ns: {error}") from error


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag.

    A bag whose files are compressed as a whole is unpacked into a temporary folder first.

    Args:
        path: a ROS 1 ``.bag``, a ROS 2 ``.db3`` or ``.mcap``, the same with ``.zstd``, or a ROS 2 bag's
            folder.

    Raises:
        NotFound: no such file.
        UnsupportedFormat: the ending is not that of a bag, or the messages are not CDR.
        MalformedData: the bag cannot be read.
        TooLarge: the unpacked files do not fit on the disk of the temporary folder.
        ModuleNotFoundError: rosbags is not installed.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    if not path.exists():
        raise NotFound(f"{path}: no such file or folder")
    if not path.is_dir() and not path.name.endswith(_ENDINGS):
        raise UnsupportedFormat(
            f"{path}: a bag is a .bag, .db3 or .mcap file, also with .zstd, or a ROS 2 bag's folder"
        )
    limit_chunks()
    ros1 = path.suffix == ".bag" and path.is_file()
    with ExitStack() as stack:
        with _damage_named(path):
            plain = path if ros1 else stack.enter_context(unpack_files(path))
            reader = Reader1(plain) if ros1 else Reader2(plain)
            reader.open()
        stack.callback(reader.close)
        if not ros1:
            _leave_messages_packed(reader)
            _check_cdr(path, reader)
        yield Bag(path, reader, ros1=ros1)


def _leave_messages_packed(reader: Any) -> None:
    """Make rosbags give compressed messages as they are: it would unpack them without a limit."""
    reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)


def _check_cdr(path: Path, reader: Any) -> None:
    others = {c.ext.serialization_format for c in reader.connections} - {"cdr"}
    if others:
        raise UnsupportedFormat(f"{path}: its messages are {', '.join(sorted(map(str, others)))}, not cdr")


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turn every exception of rosbags, which a damaged bag may raise, into MalformedData."""
    try:
        yield
    except InputError as error:  # of our decompressors
        raise type(error)(f"{path}: {error}") from error
    except FirstfixError:
        raise
    except Exception as error:  # including MemoryError: a damaged size may be exabytes
        raise MalformedData(f"{path}: the bag cannot be read: {error or type(error).__name__}") from error
