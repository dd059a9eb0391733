"""Kinds 2 and 6 of ``application/vnd.firstfix.scan``: a range image.

Directions are cells of an angular grid: 4096 around and 1024 from nadir to zenith. A cell has 0.088 by
0.176 degrees, about the accuracy of a LiDAR. Each cell keeps its nearest return. The range is rounded to a
resolution (default 2.5 cm). The cells with a return are numbered row by row. The gap between two is usually
0, and their ranges usually differ by a step or two, so that both compress well. For a sensor that sweeps
lines, 0 to 2 % of the points fall into a cell that has a nearer return, and are lost. Other sensors may use
this form too, but a pattern without lines compresses less.

The range of a decoded point is accurate to half the resolution, its direction to half a cell: at 10 m 0.8 cm
to the side and 1.5 cm up or down. Ranges below half a step or above 65,535 steps (1638 m at 2.5 cm) are left
out. Decoded points are ordered row by row, the lowest row first.

Layout, little-endian, after the six bytes that every scan begins with::

    offset  type   field
         6  u16    columns, 4 to 65535
         8  u32    return count n, at most firstfix.scan.scan.MAX_POINTS
        12  u16    rows, 2 to 65535; columns * rows at most 2 ** 24
        14  u16    0
        16  f64    resolution in metres, 0.005 to 1
        24  f64    stamp in seconds since the epoch; NaN: none
        32  u32    length of the first frame
        36  bytes  one zstd frame: the gaps
            bytes  one zstd frame: the ranges

A cell's number is row * columns + column.

A gap is the number of cells without a return between a return and the one before it (the first: from cell 0).
Each gap takes four bits, two gaps per byte, the first one in the high bits. 0 to 14 is the gap itself. 15
stands for the next wide gap. The wide gaps follow in three planes of one byte each, least significant first.

A range is the difference d from the range before (the first from 0), in steps, modulo 2 ** 16 as a signed
integer. It is zigzag-coded, z = (d << 1) ^ (d >> 15), in one byte: 0 to 254 is z itself, 255 stands for the
next wide value. The wide values follow in two planes. Ranges are integers, 1 to 65535 steps. The direction of
a return is the middle of its cell:

    azimuth   = (column + 0.5) / columns turns - half a turn
    elevation = (row + 0.5) / rows half turns - a quarter turn

Kind 6 has the times of the returns (``times``) at offset 6, in the order of their cells, and then the same.
Of several returns of a cell with the same range in steps, the first one in time is kept.
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from functools import lru_cache

import numpy as np
import zstandard
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from ..bit_exact.atan2 import atan2_turns
from ..errors import InvalidOption, MalformedData, TooLarge
from ..scan.scan import MAX_POINTS, Scan
from .frame_reader import FrameReader
from .packing import halves_of, joined, packed_halves, planes_of
from .times import Times, TimesPart

COLUMNS, ROWS = 4096, 1024
MIN_RESOLUTION_M, MAX_RESOLUTION_M = 0.005, 1.0

_HEADER = struct.Struct("<HIHHddI")
_MAX_CELLS = 1 << 24  # a gap takes three bytes
_MAX_STEPS = 65_535
_WIDE_GAP, _WIDE_RANGE = 15, 255
_ZSTD_LEVEL = 1  # level 3 is not smaller: the rest is noise

Integers = NDArray[np.int64]


def encode(scan: Scan, resolution_m: float) -> bytes:
    """Encode a scan after its first six bytes.

    Args:
        scan: its coordinates are within MAX_ABS_COORDINATE_M. With times, it begins with these.

    Raises:
        InvalidOption: a resolution outside 0.005..1 m.
        InvalidScan: a time beyond MAX_ABS_TIME_S.
    """
    if not MIN_RESOLUTION_M <= resolution_m <= MAX_RESOLUTION_M:
        raise InvalidOption(
            f"resolution_m of a range image must lie in [{MIN_RESOLUTION_M}, {MAX_RESOLUTION_M}]"
        )
    times = None if scan.time_s is None else Times.of(scan.time_s, len(scan.points))
    cells, steps, level = _nearest_by_cell(scan.points, resolution_m, None if times is None else times.level)
    compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL, write_checksum=True)
    gaps = compressor.compress(_packed_gaps(np.diff(cells, prepend=-1) - 1))
    ranges = compressor.compress(_packed_ranges(steps))
    stamp = math.nan if scan.stamp_s is None else scan.stamp_s
    header = _HEADER.pack(COLUMNS, len(cells), ROWS, 0, resolution_m, stamp, len(gaps))
    kept = b"" if times is None else replace(times, level=level).encode(compressor)
    return kept + header + gaps + ranges


def decode(rest: memoryview, *, timed: bool = False) -> Scan:
    """Decode a scan after its first six bytes. Every size is checked before memory is allocated.

    Args:
        timed: it begins with the times of the returns.

    Raises:
        MalformedData: the bytes contradict their header.
        TooLarge: over MAX_POINTS points.
    """
    reader = FrameReader(rest, "range image")
    times = TimesPart.read(reader) if timed else None
    columns, count, rows, zero, resolution_m, stamp, gap_bytes = reader.header(_HEADER)
    if count > MAX_POINTS:
        raise TooLarge(f"the scan has {count} points, the limit is {MAX_POINTS}")
    reader.check(
        {
            "grid": columns >= 4 and rows >= 2 and columns * rows <= _MAX_CELLS,
            "reserved field": zero == 0,
            "resolution": MIN_RESOLUTION_M <= resolution_m <= MAX_RESOLUTION_M,
            "stamp": not math.isinf(stamp),
        }
    )
    halves = -(-count // 2)
    gaps = reader.frame(gap_bytes, halves, halves + 3 * count)
    ranges = reader.frame(reader.left, count, 3 * count)
    points = range_image_points(
        np.frombuffer(gaps, np.uint8),
        np.frombuffer(ranges, np.uint8),
        count,
        resolution_m,
        _cosines_and_sines(columns, 2 * np.pi, np.pi),
        _cosines_and_sines(rows, np.pi, np.pi / 2),
    )
    stamp_s, time_s = None if math.isnan(stamp) else stamp, None if times is None else times.time_s(count)
    return Scan(points, None, stamp_s, time_s)


@accelerated
def range_image_points(
    gaps: NDArray[np.uint8],
    ranges: NDArray[np.uint8],
    count: int,
    resolution_m: float,
    azimuths: NDArray[np.float64],
    elevations: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The (count, 3) points of a range image, in the directions of the middles of the cells.

    Args:
        azimuths: (2, columns) cosines and sines.
        elevations: (2, rows) cosines and sines.

    Raises:
        MalformedData: the bytes contradict themselves or the grid.
    """
    columns, rows = azimuths.shape[1], elevations.shape[1]
    cells = _cells_behind(_unpacked_gaps(gaps, count), columns * rows)
    distances_m = _unpacked_ranges(ranges, count) * resolution_m
    row, column = np.divmod(cells, np.int32(columns))
    points = np.empty((count, 3), np.float32)
    across = distances_m * elevations[0, row]
    points[:, 0] = across * azimuths[0, column]
    points[:, 1] = across * azimuths[1, column]
    points[:, 2] = distances_m * elevations[1, row]
    return points


def _nearest_by_cell(
    points: NDArray[np.float32], resolution_m: float, level: NDArray[np.uint8] | None
) -> tuple[Integers, Integers, NDArray[np.uint8]]:
    """(m,) numbers of the cells with a return, ascending, its range in steps and the level of its time.

    Args:
        level: (n,) levels of the points' times; None: they have no times, and the levels are 0.
    """
    x, y, z = np.ascontiguousarray(points.T)
    across2 = x * x + y * y
    steps = np.rint(np.sqrt(across2 + z * z).astype(np.float64) * (1 / resolution_m)).astype(np.int64)
    column = ((atan2_turns(y, x) + np.float32(0.5)) * np.float32(COLUMNS)).astype(np.int64) % COLUMNS
    row = ((atan2_turns(z, np.sqrt(across2)) + np.float32(0.25)) * np.float32(2 * ROWS)).astype(np.int64)
    cell = np.minimum(row, ROWS - 1) * COLUMNS + column
    # One number per return: sorting puts the nearest return of a cell first.
    numbers = cell << 24 | steps << 8
    if level is not None:
        numbers |= level
    keys = np.sort(numbers[(steps > 0) & (steps <= _MAX_STEPS)])
    nearest = keys[np.flatnonzero(np.diff(keys >> 24, prepend=-1))]
    return nearest >> 24, nearest >> 8 & _MAX_STEPS, nearest.astype(np.uint8)


def _packed_gaps(gaps: Integers) -> bytes:
    halves = np.zeros(len(gaps) + len(gaps) % 2, np.uint8)
    halves[: len(gaps)] = np.minimum(gaps, _WIDE_GAP)
    wide = gaps[gaps >= _WIDE_GAP].astype("<u4")
    return packed_halves(halves) + planes_of(wide)[:3].tobytes()


def _unpacked_gaps(data: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    packed = data[: -(-count // 2)]
    halves = halves_of(packed)
    if halves[count:].any():
        raise MalformedData("the four bits after the last gap of the range image are not 0")
    return _with_wide(halves[:count], _WIDE_GAP, data[len(packed) :], 3)


def _cells_behind(gaps: NDArray[np.uint32], cells: int) -> NDArray[np.int32]:
    """The numbers of the cells with a return."""
    if int(gaps.sum(dtype=np.int64)) + len(gaps) > cells:
        raise MalformedData("a return of the range image is outside its grid")
    return np.cumsum(gaps + 1, dtype=np.int32) - 1


def _packed_ranges(steps: Integers) -> bytes:
    differences = np.diff(steps, prepend=0).astype("<i2")  # overflows on purpose: modulo 2 ** 16
    zigzag = ((differences << 1) ^ (differences >> 15)).view("<u2")
    small = np.minimum(zigzag, _WIDE_RANGE).astype(np.uint8)
    return small.tobytes() + planes_of(zigzag[zigzag >= _WIDE_RANGE]).tobytes()


def _unpacked_ranges(data: NDArray[np.uint8], count: int) -> NDArray[np.uint16]:
    zigzag = _with_wide(data[:count], _WIDE_RANGE, data[count:], 2).astype(np.uint16)
    differences = (zigzag >> 1) ^ (0 - (zigzag & 1))
    steps = np.cumsum(differences, dtype=np.uint16)
    if not steps.all():
        raise MalformedData("a return of the range image has the range 0")
    return steps


def _with_wide(
    small: NDArray[np.uint8], escape: int, rest: NDArray[np.uint8], planes: int
) -> NDArray[np.uint32]:
    """(n,) numbers. Each escape value is replaced by the next number of the planes."""
    wide = np.flatnonzero(small == escape)
    if len(rest) != planes * len(wide):
        raise MalformedData(f"{len(wide)} wide numbers of the range image do not fit {len(rest)} bytes")
    numbers = small.astype(np.uint32)
    numbers[wide] = joined(rest.reshape(planes, -1), np.dtype("<u4"))
    return numbers


@lru_cache(maxsize=4)
def _cosines_and_sines(parts: int, arc: float, end: float) -> NDArray[np.float64]:
    """(2, parts) of the middles of equal parts of an arc that goes up to an angle, in radians."""
    angles = (np.arange(parts) + 0.5) * (arc / parts) - end
    return np.stack([np.cos(angles), np.sin(angles)])
