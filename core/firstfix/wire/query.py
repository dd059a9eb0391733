"""The encoding ``application/vnd.firstfix.query`` for slow links.

It holds a compact scan, a descriptor, or both (``scan.compact``). It takes under 10 KB with 2,500 points, and
under 1.5 KB for the descriptor alone. clients/protocol/query.md specifies every byte.

Layout, little-endian::

    offset  type   field
         0  4 s    magic "FFQY"
         4  u8     version, 1
         5  u8     parts: 1 = compact scan, 2 = descriptor, 3 = both, in this order; 5 and 7: 1 and 3 with the
                   times of the compact scan's points (``times``) after them
         6  u16    0

Coordinates of the compact scan are rounded to a resolution, q = rint(metres / resolution). q is split into a
cell of 16 steps and the position in the cell: q = 16 * cell + low. Points are sorted by cell: z, then y,
then x::

         0  f32    resolution in metres, 0.005 to 0.1
         4  u16    point count n
         6  3 i16  lowest cell x, y, z
        12  3 u16  cells along x, y, z
        18  u16    length of the first frame
        20  u16    length of the second frame
        22  bytes  one zstd frame of 4 n bytes: planes, least significant first, of the u32 differences of
                   the cells' numbers, ((z * cells_y) + y) * cells_x + x counted from the lowest cell
            bytes  one zstd frame: a bit for each of 16,200 directions, 1 if it has a return (2025 bytes,
                   most significant bit first); then for each return the difference of its level from
                   the one before, modulo 256
            bytes  3 * ceil(n / 2), not compressed: 12 bits per point, its low x, y, z, four bits each

A level of 1 to 255 stands for the range 5 m * (exp(0.012 * level) - 1): steps of 6 cm near the sensor, and of
0.6 m at 45 m.

The descriptor::

         0  u8     kind: 1 = layered occupancy
         1  u8     layers L, 1 to 16
         2  u16    rings
         4  u16    sectors
         6  u16    length of the frame
         8  f32    radius in metres
        12  3 f32  up, sensor frame
        24  f32    height of the sensor above its floor, metres
        28  L+1 f32  layer edges above the floor, metres
            bytes  one zstd frame: ceil(L * rings * sectors / 8) bytes of bits

Every zstd frame declares its content size.
"""

from __future__ import annotations

import math
import struct
import threading
from itertools import pairwise

import numpy as np
import zstandard
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from ..descriptor import LayeredOccupancy, PolarGrid
from ..errors import InvalidOption, InvalidScan, MalformedData, TooLarge, UnsupportedFormat
from ..scan.compact import MAX_COMPACT_POINTS, CompactScan, ScanDescriptor
from ..scan.reduction import COLUMNS, ROWS
from ..scan.scan import MAX_ABS_COORDINATE_M
from .frame_reader import FrameReader
from .packing import halves_of, joined, packed_halves, planes_of
from .times import Times, TimesPart

MEDIA_TYPE = "application/vnd.firstfix.query"
MAGIC = b"FFQY"
VERSION = 1
COMPACT, DESCRIPTOR, TIMES = 1, 2, 4
MIN_RESOLUTION_M, MAX_RESOLUTION_M = 0.005, 0.1

_PARTS = (COMPACT, DESCRIPTOR, COMPACT | DESCRIPTOR, COMPACT | TIMES, COMPACT | DESCRIPTOR | TIMES)
_HEADER = struct.Struct("<4sBBH")
_COMPACT = struct.Struct("<fH3h3HHH")
_DESCRIPTOR = struct.Struct("<BBHHHf3ff")
_OCCUPANCY = 1
_CELL = 16  # steps
# The range of each level, and the range at which a level ends. Rounded to float32, so that the last digits of
# a library do not matter.
_LEVELS_M = np.array([5 * math.expm1(0.012 * level) for level in range(256)], np.float32)
_LEVEL_EDGES_M = np.array([5 * math.expm1(0.012 * (level + 0.5)) for level in range(1, 255)], np.float32)
_DIRECTIONS = ROWS * COLUMNS
_MASK_BYTES = -(-_DIRECTIONS // 8)
_MAX_LAYERS, _MAX_RINGS, _MAX_SECTORS = 16, 200, 720
_ZSTD_LEVEL = 12


class _KeptCompressor(threading.local):
    """Compressor of each thread: its tables, got from the system anew, cost a query more than the work."""

    def __init__(self) -> None:
        self.compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL)


_kept = _KeptCompressor()


def encode_query(query: CompactScan | ScanDescriptor, *, resolution_m: float = 0.02) -> bytes:
    """Encode a query. Decoded points are accurate to half the resolution, and sorted by cell.

    Raises:
        InvalidOption: a resolution outside 0.005..0.1 m.
        InvalidScan: a point, range or time is not valid, or the points are too far apart for the resolution.
        TooLarge: over MAX_COMPACT_POINTS points.
    """
    if not MIN_RESOLUTION_M <= resolution_m <= MAX_RESOLUTION_M:
        raise InvalidOption(f"resolution_m must lie in [{MIN_RESOLUTION_M}, {MAX_RESOLUTION_M}]")
    if isinstance(query, ScanDescriptor):
        return _HEADER.pack(MAGIC, VERSION, DESCRIPTOR, 0) + _descriptor_bytes(query)
    parts, (body, order) = COMPACT, _compact_bytes(query, resolution_m)
    if query.described is not None:
        parts, body = parts | DESCRIPTOR, body + _descriptor_bytes(query.described)
    if query.time_s is not None:
        parts, body = (
            parts | TIMES,
            body + Times.of(query.time_s, len(query.points)).at(order).encode(_kept.compressor),
        )
    return _HEADER.pack(MAGIC, VERSION, parts, 0) + body


def decode_query(body: bytes | memoryview) -> CompactScan | ScanDescriptor:
    """Decode a query. Every size is checked before memory is allocated.

    Raises:
        MalformedData: not this format, or the bytes contradict their headers.
        UnsupportedFormat: a later version, or another descriptor.
        TooLarge: over MAX_COMPACT_POINTS points.
    """
    rest = FrameReader(body, MEDIA_TYPE)
    magic, version, parts, zero = rest.header(_HEADER)
    if magic != MAGIC or zero:
        raise MalformedData(f"not {MEDIA_TYPE}: it begins with {bytes(body[: _HEADER.size])!r}")
    if version != VERSION or parts not in _PARTS:
        raise UnsupportedFormat(
            f"{MEDIA_TYPE} version {version} parts {parts}: only version {VERSION} and parts "
            f"{', '.join(map(str, _PARTS))} are supported"
        )
    compact = _read_compact(rest) if parts & COMPACT else None
    described = _read_descriptor(rest) if parts & DESCRIPTOR else None
    times = TimesPart.read(rest) if parts & TIMES else None
    rest.end()
    if compact is None:
        assert described is not None
        return described
    points, nearest_m = compact
    return CompactScan(points, nearest_m, described, None if times is None else times.time_s(len(points)))


def _compact_bytes(query: CompactScan, resolution_m: float) -> tuple[bytes, NDArray[np.intp]]:
    """The compact scan, and the rows of its points in the order in which they are sent."""
    n = len(query.points)
    if n > MAX_COMPACT_POINTS:
        raise TooLarge(f"the query has {n} points, the limit is {MAX_COMPACT_POINTS}")
    if n and not float(np.abs(query.points).max()) <= MAX_ABS_COORDINATE_M:
        raise InvalidScan(f"a coordinate beyond {MAX_ABS_COORDINATE_M:g} m cannot be encoded")
    resolution_m = float(np.float32(resolution_m))  # the value in the header
    (lowest, size), apart, low, order = compact_planes(query.points, resolution_m)
    if np.abs(lowest).max() > 32_767 or size.max() > 65_535 or math.prod(size.tolist()) > 1 << 32:
        raise InvalidScan(f"the points are too far apart for steps of {resolution_m:g} m")
    planes = _compressed(apart)
    ranges = _compressed(_range_bytes(query.nearest_m))
    head = _COMPACT.pack(resolution_m, n, *lowest, *size, len(planes), len(ranges))
    return head + planes + ranges + low.tobytes(), order


@accelerated
def compact_planes(
    points: NDArray[np.float32], resolution_m: float
) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.int64]]:
    """The points of a compact query as cells of 16 steps, and places in them.

    Args:
        points: (n, 3) finite metres, at most 1000.

    Returns:
        The lowest cell and the number of cells along x, y, z (2, 3); the planes of the cells' differences
        (4 n,); 12 bits for each point, its place in its cell (3 * ceil(n / 2),); the rows in this order (n,).
    """
    n = len(points)
    steps = np.rint(np.asarray(points, np.float64) / resolution_m).astype(np.int64)
    cell = steps // _CELL
    lowest = cell.min(axis=0) if n else np.zeros(3, np.int64)
    size = cell.max(axis=0) - lowest + 1 if n else np.ones(3, np.int64)
    x, y, z = (cell - lowest).T
    number = (z * size[1] + y) * size[0] + x
    order = np.argsort(number, kind="stable")
    apart = np.diff(number[order], prepend=0).astype("<u4")
    low = (steps[order] % _CELL).astype(np.uint8).ravel()  # (3 n,)
    low = np.append(low, np.zeros(3 * n % 2 * 3, np.uint8))  # an odd count: pad with a point at 0
    packed = np.frombuffer(packed_halves(low), np.uint8)
    return np.stack([lowest, size]), planes_of(apart).ravel(), packed, order


def _range_bytes(nearest_m: NDArray[np.float32]) -> NDArray[np.uint8]:
    if nearest_m.shape != (_DIRECTIONS,) or not bool((nearest_m >= 0).all()):
        raise InvalidScan(f"a compact scan needs {_DIRECTIONS} ranges of at least 0, not {nearest_m.shape}")
    return levels_of_ranges(nearest_m, _LEVEL_EDGES_M)


@accelerated
def levels_of_ranges(nearest_m: NDArray[np.float32], edges_m: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A bit for each of (n,) directions that has a return; then each return's level less the one before.

    Args:
        nearest_m: of at least 0; infinite without a return.
        edges_m: ascending ranges at which the levels from 1 on end.
    """
    returned = np.isfinite(nearest_m)
    levels = (1 + np.searchsorted(edges_m, nearest_m[returned], side="right")).astype(np.uint8)
    return np.concatenate([np.packbits(returned), np.diff(levels, prepend=np.uint8(0))])


def _descriptor_bytes(described: ScanDescriptor) -> bytes:
    descriptor, frame = described.descriptor, _compressed(described.occupancy)
    grid, edges_m = descriptor.grid, descriptor.edges_m
    head = _DESCRIPTOR.pack(
        _OCCUPANCY,
        len(edges_m) - 1,
        grid.rings,
        grid.sectors,
        len(frame),
        grid.max_range_m,
        *described.up,
        described.height_m,
    )
    return head + struct.pack(f"<{len(edges_m)}f", *edges_m) + frame


def _read_compact(rest: FrameReader) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    resolution_m, n, *corner = rest.header(_COMPACT)
    lowest, size, (planes_bytes, ranges_bytes) = corner[:3], corner[3:6], corner[6:]
    if n > MAX_COMPACT_POINTS:
        raise TooLarge(f"the query has {n} points, the limit is {MAX_COMPACT_POINTS}")
    cells = math.prod(size)
    rest.check(
        {
            "resolution": MIN_RESOLUTION_M * 0.999 <= resolution_m <= MAX_RESOLUTION_M * 1.001,
            "cell count": 1 <= cells <= 1 << 32,
        }
    )
    planes = np.frombuffer(rest.frame(planes_bytes, 4 * n, 4 * n), np.uint8).reshape(4, n)
    ranges = rest.frame(ranges_bytes, _MASK_BYTES, _MASK_BYTES + _DIRECTIONS)
    packed = np.frombuffer(rest.take(3 * -(-n // 2)), np.uint8)
    points = compact_points(planes, packed, np.array(lowest), np.array(size), resolution_m)
    return points, ranges_of_levels(np.frombuffer(ranges, np.uint8), _LEVELS_M, _DIRECTIONS)


@accelerated
def compact_points(
    planes: NDArray[np.uint8],
    low: NDArray[np.uint8],
    lowest: NDArray[np.int64],
    size: NDArray[np.int64],
    resolution_m: float,
) -> NDArray[np.float32]:
    """The (n, 3) points of a compact scan.

    Args:
        planes: (4, n) of the differences of the cells' numbers.
        low: 12 bits for each point.
        lowest: (3,) lowest cell.
        size: (3,) cells along each axis.

    Raises:
        MalformedData: a point is outside the cells, or impossibly far.
    """
    number = np.cumsum(joined(planes, np.dtype("<u4")), dtype=np.int64)
    n = len(number)
    if n and number[-1] >= size.prod():
        raise MalformedData("a point of the query is outside its cells")
    place = halves_of(low)[: 3 * n].reshape(-1, 3)
    cell = np.stack([number % size[0], number // size[0] % size[1], number // (size[0] * size[1])], axis=1)
    points = ((cell + lowest) * _CELL + place) * resolution_m
    if n and not float(np.abs(points).max()) <= MAX_ABS_COORDINATE_M * 1.001:
        raise MalformedData(f"the query has coordinates beyond {MAX_ABS_COORDINATE_M:g} m")
    return points.astype(np.float32)


@accelerated
def ranges_of_levels(
    content: NDArray[np.uint8], levels_m: NDArray[np.float32], directions: int
) -> NDArray[np.float32]:
    """The (directions,) nearest ranges, infinite where nothing returned.

    Args:
        content: a bit for each direction, then the differences of the levels.
        levels_m: (256,) range of each level.

    Raises:
        MalformedData: there is not one level for each return.
    """
    mask_bytes = -(-directions // 8)
    returned = np.unpackbits(content[:mask_bytes])[:directions].astype(np.bool_)
    differences = content[mask_bytes:]
    if len(differences) != returned.sum():
        raise MalformedData(f"{len(differences)} ranges for {returned.sum()} directions")
    levels = np.cumsum(differences, dtype=np.uint8)  # the sum overflows on purpose
    nearest_m = np.full(directions, np.inf, np.float32)
    nearest_m[returned] = levels_m[levels]
    return nearest_m


def _read_descriptor(rest: FrameReader) -> ScanDescriptor:
    kind, layers, rings, sectors, frame_bytes, radius_m, *up, height_m = rest.header(_DESCRIPTOR)
    if kind != _OCCUPANCY:
        raise UnsupportedFormat(f"descriptor kind {kind} of {MEDIA_TYPE}: only {_OCCUPANCY} is supported")
    length = math.sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2])  # the same bits on every robot
    fields = {
        "layer count": 1 <= layers <= _MAX_LAYERS,
        "ring count": 1 <= rings <= _MAX_RINGS,
        "sector count": 1 <= sectors <= _MAX_SECTORS,
        "radius": 0 < radius_m <= MAX_ABS_COORDINATE_M,
        "up vector": abs(length - 1) < 1e-3,
        "height": abs(height_m) <= 100,
    }
    rest.check(fields)
    edges_m = rest.header(struct.Struct(f"<{layers + 1}f"))
    if not all(a < b for a, b in pairwise(edges_m)) or not math.isfinite(sum(edges_m)):
        raise MalformedData("the layer edges of the descriptor do not ascend")
    content_bytes = -(-layers * rings * sectors // 8)
    occupancy = np.frombuffer(rest.frame(frame_bytes, content_bytes, content_bytes), np.uint8)
    descriptor = LayeredOccupancy(PolarGrid(rings, sectors, radius_m), edges_m)
    return ScanDescriptor(descriptor, occupancy, np.array(up) / length, height_m)


def _compressed(content: NDArray[np.uint8]) -> bytes:
    return _kept.compressor.compress(content.tobytes())
