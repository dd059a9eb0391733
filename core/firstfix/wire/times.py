"""Times of a scan's points, one byte each: the part that all encodings of a scan share.

Layout, little-endian::

    offset  type   field
         0  f32    time of level 0, in seconds from the scan's stamp
         4  f32    seconds between two levels, at least 0
         8  u32    length of the frame
        12  bytes  one zstd frame of a byte for each point: the difference of its level from that of the point
                   before, modulo 256 (the first: from 0)

    time = first + step * level

The encoder's step is a power of two, and its times are whole numbers of steps: so decoded times are exact.
A revolution of 0.1 s has steps of 0.5 ms: at 2 rad/s the sensor turns by 0.06 degrees in one, and a vehicle
at 10 m/s drives 5 mm.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
import zstandard
from numpy.typing import NDArray

from ..errors import InvalidScan, MalformedData
from ..scan.scan import MAX_ABS_TIME_S
from .frame_reader import FrameReader

_HEADER = struct.Struct("<ffI")
_LIMIT_S = MAX_ABS_TIME_S * 1.001
_LEVELS = 255  # beside level 0
_STEPS_S = tuple(2.0**exponent for exponent in range(-20, 1))


@dataclass(frozen=True)
class Times:
    """Times of points, in levels.

    Attributes:
        first_s, step_s: time of level 0, and between two levels; exact as float32.
        level: (n,) uint8.
    """

    first_s: float
    step_s: float
    level: NDArray[np.uint8]

    @classmethod
    def of(cls, time_s: NDArray[np.float32], points: int) -> Times:
        """Levels from the first to the last of the times, in the smallest steps that suffice.

        Raises:
            InvalidScan: there is not one time for each point, or one is not finite or beyond MAX_ABS_TIME_S.
        """
        if len(time_s) != points:
            raise InvalidScan(f"{len(time_s)} times for {points} points")
        if not float(np.abs(time_s).max(initial=0)) <= MAX_ABS_TIME_S:
            raise InvalidScan(f"a point's time is not within {MAX_ABS_TIME_S:g} s of the scan's stamp")
        exact = time_s.astype(np.float64)
        first, last = (float(exact.min()), float(exact.max())) if points else (0.0, 0.0)
        step = next(step for step in _STEPS_S if np.rint(last / step) - np.rint(first / step) <= _LEVELS)
        level = (np.rint(exact / step) - np.rint(first / step)).astype(np.uint8)
        return cls(float(np.rint(first / step)) * step, step, level)

    def at(self, rows: NDArray[np.integer]) -> Times:
        """The times of the given rows, with the same levels."""
        return Times(self.first_s, self.step_s, self.level[rows])

    def encode(self, compressor: zstandard.ZstdCompressor) -> bytes:
        """Encode the part."""
        frame = compressor.compress(np.diff(self.level, prepend=np.uint8(0)).tobytes())
        return _HEADER.pack(self.first_s, self.step_s, len(frame)) + frame


@dataclass(frozen=True)
class TimesPart:
    """The part as it was received. Its frame is read when the number of points is known."""

    first_s: float
    step_s: float
    frame: memoryview

    @classmethod
    def read(cls, reader: FrameReader) -> TimesPart:
        """Read the part.

        Raises:
            MalformedData: it is cut off, or a field of its header is out of range.
        """
        first_s, step_s, length = reader.header(_HEADER)
        reader.check({"first time": abs(first_s) <= _LIMIT_S, "step of the times": 0 <= step_s <= 1})
        return cls(first_s, step_s, reader.take(length))

    def time_s(self, count: int) -> NDArray[np.float32]:
        """Times (count,) in seconds from the scan's stamp.

        Raises:
            MalformedData: the frame is damaged or does not hold one time for each point, or a time is beyond
                MAX_ABS_TIME_S.
        """
        content = FrameReader(self.frame, "times").frame(len(self.frame), count, count)
        level = np.cumsum(np.frombuffer(content, np.uint8), dtype=np.uint8)  # overflows on purpose
        time_s = self.first_s + self.step_s * level
        if not float(time_s.max(initial=0)) <= _LIMIT_S:
            raise MalformedData(f"a point's time is beyond {MAX_ABS_TIME_S:g} s")
        return time_s.astype(np.float32)
