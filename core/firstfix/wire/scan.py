"""The encoding ``application/vnd.firstfix.scan`` of one scan.

It has two forms. ``points`` keeps every point, in the sensor's order, and the intensity: 1.7 to 4.4 bytes per
point at 1 cm. ``range_image`` keeps the nearest return in each of 4 million directions, without intensity:
0.4 to 0.7 bytes per point at 2.5 cm, with the same accuracy of localization. The modules ``points`` and
``range_image`` document the layouts. Both begin with

    offset  type   field
         0  4 s    magic "FFSC"
         4  u8     version, 1
         5  u8     kind: 1 = points, 2 = range image; 5 and 6: the same with the times of the points
"""

from __future__ import annotations

import struct
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidOption, InvalidScan, MalformedData, TooLarge, UnsupportedFormat
from ..scan.scan import MAX_ABS_COORDINATE_M, MAX_POINTS, Scan, all_within
from ..scan.voxel_filter import first_in_voxel
from . import points as wire_points
from . import range_image as wire_range_image

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
    """Encodes a scan. The module of the form documents the accuracy of the decoded points.

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
        kind, rest = KIND_POINTS, wire_points.encode(scan, 0.01 if resolution_m is None else resolution_m)
    else:
        kind = KIND_RANGE_IMAGE
        rest = wire_range_image.encode(scan, 0.025 if resolution_m is None else resolution_m)
    return _PREFIX.pack(MAGIC, VERSION, kind if scan.time_s is None else kind + _TIMED) + rest


def decode_scan(body: bytes | memoryview) -> Scan:
    """Decodes a scan. Every size is checked before memory is allocated.

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
    decode = wire_points.decode if form == KIND_POINTS else wire_range_image.decode
    scan = decode(memoryview(body)[_PREFIX.size :], timed=timed)
    if not all_within(scan.points, MAX_ABS_COORDINATE_M * 1.001):
        raise MalformedData(f"the scan has coordinates beyond {MAX_ABS_COORDINATE_M:g} m")
    return scan


def _one_each(time_s: NDArray[np.float32], points: int) -> NDArray[np.float32]:
    if len(time_s) != points:
        raise InvalidScan(f"{len(time_s)} times for {points} points")
    return time_s
