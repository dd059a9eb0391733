"""std_msgs/Header: time and frame of a message."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal

from ..errors import InvalidOption
from .cdr import MAX_TEXT_BYTES, CdrWriter, MessageReader

_NS = 1_000_000_000
_MAX_SECONDS = 2**31 - 1  # builtin_interfaces/Time.sec is an int32
_DECIMAL_SECONDS = re.compile(r"\d{1,10}(\.\d{1,9})?")


@dataclass(frozen=True, order=True)
class Stamp:
    """builtin_interfaces/Time. Zero means "not known", as everywhere in ROS."""

    sec: int = 0
    nanosec: int = 0

    @classmethod
    def of_ns(cls, ns: int) -> Stamp:
        """Make a stamp from nanoseconds since the epoch."""
        return cls(*divmod(ns, _NS))

    @classmethod
    def parse(cls, text: str) -> Stamp:
        """Parse decimal seconds since the epoch, exact to the nanosecond: ``1700000000.25``.

        Raises:
            InvalidOption: not such a number, or beyond the range of ROS.
        """
        if not _DECIMAL_SECONDS.fullmatch(text) or Decimal(text) >= _MAX_SECONDS + 1:
            raise InvalidOption(f"a stamp must be decimal seconds since the epoch, not {text[:40]!r}")
        return cls.of_ns(int(Decimal(text) * _NS))

    def __str__(self) -> str:
        return f"{self.sec}.{self.nanosec:09d}"

    @property
    def ns(self) -> int:
        """Nanoseconds since the epoch."""
        return self.sec * _NS + self.nanosec

    @property
    def seconds(self) -> float | None:
        """Seconds since the epoch, exact to 0.25 microseconds. None if not known."""
        return self.ns / _NS if self.ns else None


@dataclass(frozen=True)
class Header:
    """Time and frame of a message."""

    stamp: Stamp
    frame_id: str


def read_header(reader: MessageReader) -> Header:
    """Read a header.

    Raises:
        MalformedData: not a header.
    """
    return Header(read_stamp(reader), reader.text())


def read_stamp(reader: MessageReader) -> Stamp:
    """Read the first part of a header.

    Raises:
        MalformedData: not a stamp.
    """
    if reader.ros1:
        reader.number("I")  # the sequence number, which ROS 2 does not have
    sec, nanosec = reader.number("I" if reader.ros1 else "i"), reader.number("I")
    if sec < 0 or nanosec >= _NS:
        reader.fail(f"a stamp of {sec} s and {nanosec} ns is not valid")
    return Stamp(sec, nanosec)


def write_header(writer: CdrWriter, header: Header) -> None:
    """Write a header."""
    writer.numbers("i", [header.stamp.sec])
    writer.numbers("I", [header.stamp.nanosec])
    writer.text(header.frame_id)


def check_frame(frame_id: str) -> str:
    """The name of a frame after a check.

    Raises:
        InvalidOption: not a valid name.
    """
    if not frame_id or len(frame_id.encode()) >= MAX_TEXT_BYTES or not frame_id.isprintable():
        raise InvalidOption(f"not a valid frame name: {frame_id[:80]!r}")
    return frame_id
