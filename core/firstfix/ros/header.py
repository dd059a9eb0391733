"""std_msgs/Header: when and in which frame."""

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
    """builtin_interfaces/Time. Zero stands for "not known", as everywhere in ROS."""

    sec: int = 0
    nanosec: int = 0

    @classmethod
    def of_ns(cls, ns: int) -> Stamp:
        return cls(*divmod(ns, _NS))

    @classmethod
    def parse(cls, text: str) -> Stamp:
        """Decimal seconds since the epoch, exact to the nanosecond: ``1700000000.25``.

        Raises:
            InvalidOption: no such number, or beyond what ROS can say.
        """
        if not _DECIMAL_SECONDS.fullmatch(text) or Decimal(text) >= _MAX_SECONDS + 1:
            raise InvalidOption(f"a stamp is decimal seconds since the epoch, not {text[:40]!r}")
        return cls.of_ns(int(Decimal(text) * _NS))

    def __str__(self) -> str:
        return f"{self.sec}.{self.nanosec:09d}"

    @property
    def ns(self) -> int:
        return self.sec * _NS + self.nanosec

    @property
    def seconds(self) -> float | None:
        """As a float, to a quarter of a microsecond; None where it is not known."""
        return self.ns / _NS if self.ns else None


@dataclass(frozen=True)
class Header:
    stamp: Stamp
    frame_id: str


def read_header(reader: MessageReader) -> Header:
    """
    Raises:
        MalformedData: not a header's bytes.
    """
    return Header(read_stamp(reader), reader.text())


def read_stamp(reader: MessageReader) -> Stamp:
    """The first part of a header.

    Raises:
        MalformedData: not a stamp's bytes.
    """
    if reader.ros1:
        reader.number("I")  # the sequence number, which ROS 2 has given up
    sec, nanosec = reader.number("I" if reader.ros1 else "i"), reader.number("I")
    if sec < 0 or nanosec >= _NS:
        reader.fail(f"no stamp has {sec} s and {nanosec} ns")
    return Stamp(sec, nanosec)


def write_header(writer: CdrWriter, header: Header) -> None:
    writer.numbers("i", [header.stamp.sec])
    writer.numbers("I", [header.stamp.nanosec])
    writer.text(header.frame_id)


def check_frame(frame_id: str) -> str:
    """
    Raises:
        InvalidOption: no name of a frame.
    """
    if not frame_id or len(frame_id.encode()) >= MAX_TEXT_BYTES or not frame_id.isprintable():
        raise InvalidOption(f"no frame is called {frame_id[:80]!r}")
    return frame_id
