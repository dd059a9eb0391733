"""The encoding ``application/vnd.firstfix.scan`` of one scan.

It has two forms. ``points`` keeps every point, in the sensor's order, and the intensity: 1.7 to 4.4 bytes per
point at 1 cm. ``range_image`` keeps the nearest return in each of 4 million directions, without intensity:
0.4 to 0.7 bytes per point at 2.5 cm, with the same accuracy of localization. The module
``range_image`` documents the layout of the latter. Both begin with

    offset  type   field
         0  4 s    magic "FFSC"
         4  u8     version, 1
         5  u8     kind: 1 = points, 2 = range image; 5 and 6: the same with the times of the points

Kind 1 has every point of a scan, in the sensor's order.

Coordinates are rounded to a resolution (default 1 cm). Each point is written as its difference from the
point before it. Bytes of equal weight are put side by side, so that zstd finds runs of equal bytes. A scan of
124,000 points of a spinning LiDAR takes about 205 KiB, and about 2 ms to encode or decode.

Its layout, little-endian, after these six bytes::

    offset  type   field
         6  u8     bytes per coordinate c: 2 or 4
         7  u8     bytes per intensity i: 0 (none), 1 or 2
         8  u32    point count n, at most firstfix.scan.scan.MAX_POINTS
        12  u32    0
        16  f64    resolution in metres, 0.0001 to 1
        24  3 f64  origin x, y, z in metres
        48  f64    stamp in seconds since the epoch; NaN: none
        56  f32    intensity scale
        60  f32    intensity offset
        64  bytes  one zstd frame that declares its content size: n * (3 c + i) bytes

The frame's content is 3 c planes of n bytes: for x, then y, then z, the least significant byte of every
point's difference, then the next byte, up to the most significant. Then i planes for the intensity.
A difference is q[k] - q[k - 1] modulo 2 ** (8 c), with q[-1] = 0, and q is a signed integer of c bytes:

    coordinate = origin + resolution * q          intensity = offset + scale * (unsigned value)

Two bytes reach 327 m to each side of the origin at 1 cm. For a scan that reaches further, the encoder moves
the origin to the middle of the scan. If that is not enough, it takes four bytes. No point is dropped.

Kind 5 has the times of the points (``times``) at offset 6, and then the same.
"""

from __future__ import annotations

import math
import struct
from typing import Literal

import numpy as np
import zstandard
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from ..errors import InvalidOption, InvalidScan, MalformedData, TooLarge, UnsupportedFormat
from ..scan.reduction import first_in_voxel
from ..scan.scan import MAX_ABS_COORDINATE_M, MAX_POINTS, Scan, all_within
from . import range_image as wire_range_image
from .frame_reader import FrameReader
from .packing import joined, planes_of
from .times import Times, TimesPart

MIN_RESOLUTION_M, MAX_RESOLUTION_M = 1e-4, 1.0

_HEADER = struct.Struct("<BBIId3ddff")
# Level 4 takes half as much time again and saves 1 %: the planes hold noise, not patterns.
_ZSTD_LEVEL = 1
_MAX_INTENSITY = 1e30  # 65,536 steps of its range still fit float32


def encode_points(scan: Scan, resolution_m: float) -> bytes:
    """Encode a scan after its first six bytes. Coordinates are accurate to half the resolution.

    Args:
        scan: its coordinates are within MAX_ABS_COORDINATE_M. With times, it begins with these.

    Raises:
        InvalidOption: a resolution outside 0.0001..1 m.
        InvalidScan: a time beyond MAX_ABS_TIME_S.
    """
    if not MIN_RESOLUTION_M <= resolution_m <= MAX_RESOLUTION_M:
        raise InvalidOption(f"resolution_m must lie in [{MIN_RESOLUTION_M}, {MAX_RESOLUTION_M}]")
    points, intensity = scan.points, _finite(scan.intensity)
    origin, coordinate_bytes = _frame_of(points, resolution_m)
    intensity_bytes, scale, offset = _intensity_form(intensity)
    n, stamp = len(points), math.nan if scan.stamp_s is None else scan.stamp_s
    header = _HEADER.pack(
        coordinate_bytes, intensity_bytes, n, 0, resolution_m, *origin, stamp, scale, offset
    )
    planes = np.empty((3 * coordinate_bytes + intensity_bytes, n), np.uint8)
    quantised = np.rint((points - origin) * (1 / resolution_m)).astype(f"<i{coordinate_bytes}")
    differences = np.diff(quantised, axis=0, prepend=np.zeros((1, 3), quantised.dtype))
    planes[: 3 * coordinate_bytes] = differences.view(np.uint8).reshape(n, 3 * coordinate_bytes).T
    if intensity is not None:
        levels = np.rint((intensity - offset) / scale)
        planes[3 * coordinate_bytes :] = planes_of(levels.astype(f"<u{intensity_bytes}"))
    compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL, write_checksum=True)
    times = b"" if scan.time_s is None else Times.of(scan.time_s, n).encode(compressor)
    return times + header + compressor.compress(planes.data)


def decode_points(rest: memoryview, *, timed: bool = False) -> Scan:
    """Decode a scan after its first six bytes. Every size is checked before memory is allocated.

    Args:
        timed: it begins with the times of the points.

    Raises:
        MalformedData: the bytes contradict their header.
        TooLarge: over MAX_POINTS points.
    """
    reader = FrameReader(rest, "scan")
    times = TimesPart.read(reader) if timed else None
    c, i, n, zero, resolution_m, *origin, stamp, scale, offset = reader.header(_HEADER)
    if n > MAX_POINTS:
        raise TooLarge(f"the scan has {n} points, the limit is {MAX_POINTS}")
    reader.check(
        {
            "bytes per coordinate": c in (2, 4),
            "bytes per intensity": i in (0, 1, 2),
            "reserved field": zero == 0,
            "resolution": MIN_RESOLUTION_M <= resolution_m <= MAX_RESOLUTION_M,
            "origin": all(abs(v) <= MAX_ABS_COORDINATE_M for v in origin),
            "stamp": not math.isinf(stamp),
            "intensity scale": abs(scale) * 65_535 <= 4 * _MAX_INTENSITY
            and abs(offset) <= 2 * _MAX_INTENSITY,
        }
    )
    content = reader.frame(reader.left, n * (3 * c + i), n * (3 * c + i))
    planes = np.frombuffer(content, np.uint8).reshape(3 * c + i, n)
    points = points_of_planes(planes[: 3 * c], resolution_m, np.array(origin))
    intensity = intensity_of_planes(planes[3 * c :], scale, offset) if i else None
    stamp_s, time_s = None if math.isnan(stamp) else stamp, None if times is None else times.time_s(n)
    return Scan(points, intensity, stamp_s, time_s)


@accelerated
def points_of_planes(
    planes: NDArray[np.uint8], resolution_m: float, origin: NDArray[np.float64]
) -> NDArray[np.float32]:
    """The (n, 3) points of (3 c, n) planes, c for the differences of each coordinate."""
    c, n = len(planes) // 3, planes.shape[1]
    points = np.empty((n, 3), np.float32)
    integer = np.dtype(f"<i{c}")
    for axis in range(3):
        differences = joined(planes[axis * c : (axis + 1) * c], integer)
        # the sum overflows on purpose: differences are modulo 2 ** (8 c)
        points[:, axis] = np.cumsum(differences, dtype=integer) * resolution_m + origin[axis]
    return points


@accelerated
def intensity_of_planes(planes: NDArray[np.uint8], scale: float, offset: float) -> NDArray[np.float32]:
    """The (n,) intensities of one or two planes."""
    levels = joined(planes, np.dtype(f"<u{len(planes)}"))
    return (levels * scale + offset).astype(np.float32)


def _frame_of(points: NDArray[np.float32], resolution_m: float) -> tuple[NDArray[np.float64], int]:
    """The origin (3,) and the bytes per coordinate that hold every point."""
    reach_m = 32_767 * resolution_m
    origin = np.zeros(3)
    if float(np.abs(points).max(initial=0)) <= reach_m:
        return origin, 2
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    if float((high - low).max()) / 2 <= reach_m - resolution_m:
        return np.rint((low + high) / 2 / resolution_m) * resolution_m, 2
    return origin, 4


def _finite(intensity: NDArray[np.float32] | None) -> NDArray[np.float64] | None:
    if intensity is None:
        return None
    return np.clip(np.nan_to_num(intensity), -_MAX_INTENSITY, _MAX_INTENSITY).astype(np.float64)


def _intensity_form(intensity: NDArray[np.float64] | None) -> tuple[int, float, float]:
    """Bytes, scale and offset: exact for integers of 8 or 16 bits, else 65,536 steps of the range."""
    if intensity is None:
        return 0, 1.0, 0.0
    low, high = (float(intensity.min()), float(intensity.max())) if len(intensity) else (0.0, 0.0)
    if low >= 0 and high <= 65_535 and bool((intensity == np.rint(intensity)).all()):
        return (1 if high <= 255 else 2), 1.0, 0.0
    # As float32, like the header. One step larger, so that the last level cannot overflow.
    offset = float(np.nextafter(np.float32(low), np.float32(-np.inf)))
    scale = float(np.nextafter(np.float32((high - offset) / 65_535), np.float32(np.inf)))
    return 2, scale, offset


MEDIA_TYPE = "application/vnd.firstfix.scan"
MAGIC = b"FFSC"
VERSION = 1
KIND_POINTS, KIND_RANGE_IMAGE = 1, 2
_TIMED = 4  # more than the kind of the same without times

ScanForm = Literal["points", "range_image"]

_PREFIX = struct.Struct("<4sBB")


def encode_scan(
    scan: Scan,
    *,
    form: ScanForm = "points",
    resolution_m: float | None = None,
    voxel_m: float | None = None,
) -> bytes:
    """Encode a scan. The module of the form documents the accuracy of the decoded points.

    Args:
        resolution_m: step of coordinates or of ranges; None: 0.01 for points, 0.025 for a range image.
        voxel_m: edge of a voxel. If given, only the first point of each voxel is sent.

    Raises:
        InvalidOption: an unknown form; a resolution outside 0.0001..1 m (points) or 0.005..1 m (range image);
            a voxel outside 0.01..10 m.
        InvalidScan: a coordinate is not finite or beyond MAX_ABS_COORDINATE_M, or a time beyond
            MAX_ABS_TIME_S.
        TooLarge: over MAX_POINTS points.
    """
    if form not in ("points", "range_image"):
        raise InvalidOption(f"form must be points or range_image, not {form!r}")
    if voxel_m is not None and not 0.01 <= voxel_m <= 10:
        raise InvalidOption("voxel_m must lie in [0.01, 10]")
    if len(scan) > MAX_POINTS:
        raise TooLarge(f"the scan has {len(scan)} points, the limit is {MAX_POINTS}")
    furthest_m = float(np.abs(scan.points).max(initial=0))
    if not furthest_m <= MAX_ABS_COORDINATE_M:
        raise InvalidScan(f"a coordinate of {furthest_m} m cannot be encoded; see Scan.from_points")
    if voxel_m is not None:
        kept = first_in_voxel(scan.points, voxel_m)
        intensity = None if scan.intensity is None else scan.intensity[kept]
        time_s = None if scan.time_s is None else _one_each(scan.time_s, len(scan))[kept]
        scan = Scan(scan.points[kept], intensity, scan.stamp_s, time_s)
    if form == "points":
        kind, rest = KIND_POINTS, encode_points(scan, 0.01 if resolution_m is None else resolution_m)
    else:
        kind = KIND_RANGE_IMAGE
        rest = wire_range_image.encode(scan, 0.025 if resolution_m is None else resolution_m)
    return _PREFIX.pack(MAGIC, VERSION, kind if scan.time_s is None else kind + _TIMED) + rest


def decode_scan(body: bytes | memoryview) -> Scan:
    """Decode a scan. Every size is checked before memory is allocated.

    Raises:
        MalformedData: not this format, or the bytes contradict their header.
        UnsupportedFormat: a later version or another kind of this format.
        TooLarge: over MAX_POINTS points.
    """
    if len(body) < _PREFIX.size:
        raise MalformedData(f"{len(body)} bytes are too few for {MEDIA_TYPE}")
    magic, version, kind = _PREFIX.unpack_from(body)
    if magic != MAGIC:
        raise MalformedData(f"not {MEDIA_TYPE}: it begins with {magic!r}, not {MAGIC!r}")
    timed = kind > _TIMED
    form = kind - _TIMED if timed else kind
    if version != VERSION or form not in (KIND_POINTS, KIND_RANGE_IMAGE):
        raise UnsupportedFormat(
            f"{MEDIA_TYPE} version {version} kind {kind}: only version 1, kinds 1, 2, 5 and 6 are supported"
        )
    decode = decode_points if form == KIND_POINTS else wire_range_image.decode
    scan = decode(memoryview(body)[_PREFIX.size :], timed=timed)
    if not all_within(scan.points, MAX_ABS_COORDINATE_M * 1.001):
        raise MalformedData(f"the scan has coordinates beyond {MAX_ABS_COORDINATE_M:g} m")
    return scan


def _one_each(time_s: NDArray[np.float32], points: int) -> NDArray[np.float32]:
    if len(time_s) != points:
        raise InvalidScan(f"{len(time_s)} times for {points} points")
    return time_s
