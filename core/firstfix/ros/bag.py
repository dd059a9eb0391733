"""Bags without ROS: ROS 1 files, ROS 2 folders, sqlite3 and mcap files, one message in memory at a time.

For the command line: rosbags believes the sizes that a bag declares, so bags from strangers are not opened.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import FirstfixError, InvalidOption, MalformedData, NotFound, UnsupportedFormat
from . import point_cloud2


@dataclass(frozen=True)
class RawMessage:
    """
    Attributes:
        time_ns: when it was recorded.
        body: serialised, as ROS 1 or CDR: the bag's ``ros1`` says which.
    """

    topic: str
    time_ns: int
    body: bytes


class Bag:
    """An open bag; ``open_bag`` makes it."""

    def __init__(self, path: Path, reader: Any, *, ros1: bool) -> None:
        self.path = path
        self.ros1 = ros1
        self._reader = reader

    @property
    def start_ns(self) -> int:
        """When its first message was recorded."""
        return int(self._reader.start_time)

    def topics(self, message_type: str) -> list[str]:
        """Names of the topics of one type that hold messages, sorted."""
        return sorted({c.topic for c in self._reader.connections if c.msgtype == message_type and c.msgcount})

    def cloud_topic(self, wanted: str | None) -> str:
        """The topic to replay: the one that is wanted, or the only one with clouds.

        Raises:
            NotFound: the wanted one holds no clouds, or there are none at all.
            InvalidOption: there are several and none is wanted.
        """
        topics = self.topics(point_cloud2.TYPE)
        if wanted is not None:
            self.check_topic(wanted, point_cloud2.TYPE)
            return wanted
        if not topics:
            raise NotFound(f"{self.path}: no topic holds {point_cloud2.TYPE}")
        if len(topics) > 1:
            raise InvalidOption(f"{self.path}: several topics hold clouds, name one: {', '.join(topics)}")
        return topics[0]

    def check_topic(self, topic: str, message_type: str) -> None:
        """
        Raises:
            NotFound: it holds no such messages; the message says which topics do.
        """
        topics = self.topics(message_type)
        if topic not in topics:
            raise NotFound(
                f"{self.path}: {topic} holds no {message_type}; those that do: {', '.join(topics) or 'none'}"
            )

    def messages(self, topics: list[str], start_ns: int | None = None) -> Iterator[RawMessage]:
        """In the order in which they were recorded.

        Raises:
            MalformedData: the bag is damaged there.
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
            yield RawMessage(connection.topic, time_ns, bytes(body))


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """
    Args:
        path: a ROS 1 ``.bag``, a ROS 2 ``.db3`` or ``.mcap``, or a ROS 2 bag's folder.

    Raises:
        NotFound: no such file.
        UnsupportedFormat: no bag by its ending, or its messages are no CDR.
        MalformedData: it cannot be read.
        ModuleNotFoundError: rosbags is not installed.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    if not path.exists():
        raise NotFound(f"{path}: no such file or folder")
    if not path.is_dir() and path.suffix not in (".bag", ".db3", ".mcap"):
        raise UnsupportedFormat(f"{path}: a bag is a .bag, .db3 or .mcap file, or a ROS 2 bag's folder")
    ros1 = path.suffix == ".bag" and path.is_file()
    with _damage_named(path):
        reader = Reader1(path) if ros1 else Reader2(path)
        reader.open()
    try:
        if not ros1:
            _check_cdr(path, reader)
        yield Bag(path, reader, ros1=ros1)
    finally:
        reader.close()


def _check_cdr(path: Path, reader: Any) -> None:
    others = {c.ext.serialization_format for c in reader.connections} - {"cdr"}
    if others:
        raise UnsupportedFormat(f"{path}: its messages are {', '.join(sorted(others))}, not cdr")


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """A damaged bag makes rosbags raise whatever its parser stumbles over: all of it means one thing."""
    try:
        yield
    except FirstfixError:
        raise
    except Exception as error:  # MemoryError among them: a damaged size may ask for exabytes
        raise MalformedData(f"{path}: the bag cannot be read: {error or type(error).__name__}") from error
