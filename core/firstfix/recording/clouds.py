"""Clouds of a topic, whatever its messages are: what a reader of a message type gives."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from ..errors import InputError, MalformedData, NotFound
from ..formats.point_cloud import SCAN_LIMITS, Limits
from ..ros.cdr import MessageReader
from ..ros.header import Header, read_header
from ..ros.point_cloud2 import StampedCloud
from .messages import RawMessage

Decode = Callable[[RawMessage, Limits], StampedCloud]


def ros_header(message: RawMessage) -> Header:
    """The header that a message of ROS begins with.

    Raises:
        MalformedData, UnsupportedFormat: it has no valid one.
    """
    return read_header(MessageReader(message.type, message.body, ros1=message.ros1))


class RecordedCloud(Protocol):
    """A cloud that is decoded when it is asked for: one that is not used may be damaged.

    Attributes:
        topic: of the recording.
        time_ns: time of recording.
    """

    @property
    def topic(self) -> str: ...  # noqa: D102
    @property
    def time_ns(self) -> int: ...  # noqa: D102

    def header(self) -> Header:
        """Its time and frame."""

    def cloud(self) -> StampedCloud:
        """Its points."""


class CloudReader(Protocol):
    """Makes clouds of the messages of one topic, in their order."""

    def add(self, message: RawMessage) -> list[RecordedCloud]:
        """Take the next message. Returns the clouds that it completes."""

    def end(self) -> list[RecordedCloud]:
        """The clouds that the last messages have begun."""


@dataclass(frozen=True)
class CloudOfMessage:
    """The cloud of one message."""

    message: RawMessage
    decode: Decode
    read_header: Callable[[RawMessage], Header]
    where: str

    @property
    def topic(self) -> str:
        """Topic of the message."""
        return self.message.topic

    @property
    def time_ns(self) -> int:
        """Time of its recording."""
        return self.message.time_ns

    def header(self) -> Header:
        """Its time and frame.

        Raises:
            MalformedData, UnsupportedFormat: it has no valid header.
        """
        with named(self.where):
            return self.read_header(self.message)

    def cloud(self) -> StampedCloud:
        """Its points.

        Raises:
            InputError: a subclass; the message is damaged, or too large.
        """
        with named(self.where):
            return self.decode(self.message, SCAN_LIMITS)


@dataclass(frozen=True)
class DecodedCloud:
    """A cloud that a library has made of packets."""

    topic: str
    time_ns: int
    decoded: StampedCloud

    def header(self) -> Header:
        """Its time and frame."""
        return self.decoded.header

    def cloud(self) -> StampedCloud:
        """Its points."""
        return self.decoded


@dataclass(frozen=True)
class OneByOne:
    """Reader of messages of which each is a cloud.

    Attributes:
        decode: of one message.
        bag: name of the recording, for errors.
    """

    decode: Decode
    bag: str
    read_header: Callable[[RawMessage], Header] = ros_header

    def add(self, message: RawMessage) -> list[RecordedCloud]:
        """The cloud of the message."""
        return [
            CloudOfMessage(
                message, self.decode, self.read_header, where(self.bag, message.topic, message.time_ns)
            )
        ]

    def end(self) -> list[RecordedCloud]:
        """None: no message waits for another."""
        return []


def check_axes(format_name: str, names: Iterable[str]) -> None:
    """Check that x, y and z are among the names of a cloud's fields.

    Raises:
        MalformedData: one of them is missing.
    """
    missing = sorted({"x", "y", "z"} - set(names))
    if missing:
        raise MalformedData(f"{format_name}: no field {', '.join(missing)}")


def where(bag: str, topic: str, time_ns: int) -> str:
    """Names a message in an error."""
    return f"{bag}: the message of {topic} recorded at {time_ns} ns"


@contextmanager
def named(place: str) -> Iterator[None]:
    """Say in an error of the input where it comes from."""
    try:
        yield
    except (InputError, NotFound) as error:
        raise type(error)(f"{place}: {error}") from error
