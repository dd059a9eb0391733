"""A recording of a robot: its topics, its messages, and the clouds of its LiDARs, whatever form they have.

Bags of ROS 1 and 2, with files of sqlite3 and mcap, compressed or not, complete or cut off; captures of
packets. One message is in memory at a time, or the messages of one chunk. For local files only: the libraries
that parse ROS 1 bags and packets trust what these declare.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..errors import FirstfixError, InputError, InvalidOption, MalformedData, NotFound
from . import lidar_types
from .bag_files import bag_files
from .capture_file import ENDINGS as CAPTURES
from .capture_file import CaptureFile
from .clouds import CloudReader, RecordedCloud
from .compression import unpack_message
from .mcap_file import McapFile
from .messages import CDR, RawMessage, Topic
from .ros1_file import Ros1File
from .sqlite_file import SqliteFile
from .storage import Storage
from .time_order import Part, in_time_order

_STORAGES: dict[str, Callable[[Path], Storage]] = {
    ".mcap": McapFile,
    ".db3": SqliteFile,
    ".bag": Ros1File,
    **dict.fromkeys(CAPTURES, CaptureFile),
}


class Recording:
    """An open recording, see ``open_recording``.

    Attributes:
        topics: those that have messages, by name.
        start_ns: time of the first message.
        notes: what a user should know of the way it was read, a sentence each: that it was cut off.
    """

    def __init__(self, path: Path, storages: Sequence[Storage], notes: Sequence[str]) -> None:
        self.path = path
        self._storages = storages
        counts: dict[tuple[str, str, str], int | None] = {}
        for topic in (topic for storage in storages for topic in storage.topics):
            key = (topic.name, topic.type, topic.encoding)
            counts[key] = None if topic.count is None else (counts.get(key) or 0) + topic.count
        self.topics = [Topic(*key, count) for key, count in sorted(counts.items(), key=lambda one: one[0])]
        self.start_ns = min((storage.start_ns for storage in storages if storage.topics), default=0)
        self.notes = [*notes, *(note for storage in storages for note in storage.notes)]

    def topics_of(self, message_type: str) -> list[str]:
        """The sorted names of the topics of one type."""
        return sorted({topic.name for topic in self.topics if topic.type == message_type})

    @property
    def cloud_topics(self) -> list[Topic]:
        """The topics of clouds, by name."""
        return [topic for topic in self.topics if lidar_types.has_clouds(topic)]

    def cloud_topic(self, wanted: str | None) -> Topic:
        """The topic to replay: the wanted one, or the only one with clouds.

        Packets, and packed clouds, count only where there are no plain ones: they are the same LiDAR's.

        Raises:
            NotFound: the wanted topic, or every topic, has no clouds. The error says what is there, and what
                makes clouds of it.
            InvalidOption: several topics have clouds, and no topic is wanted.
        """
        found = sorted(self.cloud_topics, key=lidar_types.preference)
        if wanted is not None:
            of_name = [topic for topic in found if topic.name == wanted]
            if not of_name:
                named = [topic for topic in self.topics if topic.name == wanted]
                had = f" but {', '.join(topic.type for topic in named)}" if named else ""
                raise NotFound(
                    f"{self.path}: {wanted} has no clouds{had}; topics that have: {_names(found)}"
                    f"{self._not_taken(named)}"
                )
            return of_name[0]
        if not found:
            raise NotFound(f"{self.path}: no topic has clouds{self._what_is_there()}")
        best = [topic for topic in found if lidar_types.preference(topic) == lidar_types.preference(found[0])]
        if len(best) > 1:
            raise InvalidOption(f"{self.path}: several topics have clouds, choose one: {_names(best)}")
        return best[0]

    def _what_is_there(self) -> str:
        if not self.topics:
            return ": it has no messages"
        types = sorted({topic.type or "without a type" for topic in self.topics})
        return self._not_taken(self.topics) or f"; its messages are {', '.join(types)}"

    def _not_taken(self, topics: Sequence[Topic]) -> str:
        said = [(topic, lidar_types.remedy(topic)) for topic in topics]
        return "".join(f". {topic.name} has {topic.type}: {remedy}" for topic, remedy in said if remedy)

    def check_topic(self, topic: str, message_type: str) -> None:
        """Check that a topic has messages of a type.

        Raises:
            NotFound: it has none; the error names the topics that have.
        """
        topics = self.topics_of(message_type)
        if topic not in topics:
            raise NotFound(
                f"{self.path}: {topic} has no {message_type}; topics that have: {', '.join(topics) or 'none'}"
            )

    def schema(self, topic: Topic) -> bytes:
        """The definition of a topic's messages as it was recorded; empty: the recording has none."""
        files = [storage for storage in self._storages if isinstance(storage, McapFile)]
        return next((file.schema(topic) for file in files if file.schema(topic)), b"")

    def messages(self, topics: Sequence[str], start_ns: int | None = None) -> Iterator[RawMessage]:
        """Yield the messages of topics in the order of recording, over all files.

        Raises:
            MalformedData: the recording is damaged.
            TooLarge: a message or a chunk of messages is over its limit when it is unpacked.
        """
        wanted = frozenset(topics)
        parts = [
            Part(storage.start_ns, partial(_timed, storage, wanted, start_ns))
            for storage in self._storages
            if any(topic.name in wanted for topic in storage.topics)
        ]
        with _damage_named(self.path):  # what a caller raises between two messages does not come here
            for _, message in in_time_order(parts):
                yield _unpacked(message) if message.encoding == CDR else message

    def cloud_reader(self, topic: Topic) -> CloudReader:
        """Make what turns the messages of a topic into clouds.

        Raises:
            NotFound, MalformedData: what it needs is not in the recording, or damaged.
            ModuleNotFoundError: a package that the type needs is not installed; the error says how to get it.
        """
        return lidar_types.cloud_reader(self, topic)

    def clouds(self, topic: Topic, start_ns: int | None = None) -> Iterator[RecordedCloud]:
        """Yield the clouds of one topic in the order of recording. Each is decoded when it is asked for.

        Raises:
            InputError: a subclass; as ``messages`` and ``cloud_reader``.
        """
        reader = self.cloud_reader(topic)
        for message in self.messages([topic.name], start_ns):
            if (message.type, message.encoding) == (topic.type, topic.encoding):
                yield from reader.add(message)
        yield from reader.end()


def _unpacked(message: RawMessage) -> RawMessage:
    try:
        body = unpack_message(message.body)
    except InputError as error:
        at = f"the message of {message.topic} recorded at {message.time_ns} ns"
        raise type(error)(f"{at}: {error}") from error
    if body is message.body:
        return message
    return replace(message, body=body)


def _timed(
    storage: Storage, topics: frozenset[str], start_ns: int | None
) -> Iterator[tuple[int, RawMessage]]:
    return ((message.time_ns, message) for message in storage.messages(topics, start_ns))


def _names(topics: Sequence[Topic]) -> str:
    return ", ".join(sorted(topic.name for topic in topics)) or "none"


def is_recording(path: Path) -> bool:
    """Whether a path is a recording's by its name: a file with its ending, or the folder of a ROS 2 bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or any(
            one.suffix in (".mcap", ".db3") for one in path.iterdir()
        )
    return path.name.lower().removesuffix(".zstd").removesuffix(".active").endswith(tuple(_STORAGES))


@contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a recording.

    A bag whose files are compressed as a whole is unpacked into a temporary folder first.

    Args:
        path: a ROS 1 ``.bag``, a ROS 2 ``.db3`` or ``.mcap``, the same with ``.zstd``, a ROS 2 bag's folder,
            with its ``metadata.yaml`` or without; a ``.pcap`` of an Ouster or a Velodyne, or an ``.osf``.

    Raises:
        NotFound: no such file, or what belongs to it is not beside it.
        UnsupportedFormat: the ending is not that of a recording, or a capture is of another maker.
        MalformedData: it cannot be read.
        TooLarge: the unpacked files do not fit on the disk of the temporary folder.
        ModuleNotFoundError: a package is not installed; the error says how to get it.
    """
    if not path.exists():
        raise NotFound(f"{path}: no such file or folder")
    with ExitStack() as stack:
        with _damage_named(path):
            files = stack.enter_context(bag_files(path, CAPTURES))
            storages = []
            for one in files.paths:
                storages.append(_STORAGES[one.suffix.lower()](one))
                stack.callback(storages[-1].close)
            recording = Recording(path, storages, files.notes)
        yield recording


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turn every exception of a library, which damaged files may raise, into MalformedData."""
    try:
        yield
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    except (FirstfixError, ModuleNotFoundError):
        raise
    except Exception as error:  # including MemoryError: a damaged size may be exabytes
        raise MalformedData(
            f"{path}: the recording cannot be read: {str(error) or type(error).__name__}"
        ) from error
