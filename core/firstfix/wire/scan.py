"""The scan encoding ``application/vnd.firstfix.scan``: what the SDK sends over a radio link.

It has two forms. ``points`` keeps every point, in the sensor's order, and the intensity: 1.7 to 4.4 bytes a
point at 1 cm. ``range_image`` keeps the nearest return in each of 4 million directions, without intensity:
0.4 to 0.7 bytes a point at 2.5 cm, which localizes as well. ``wire_points`` and ``wire_range_image`` have
the layout of each; both begin with

    offset  type   field
         0  4 s    magic "FFSC"
         4  u8     version, 1
         5  u8     kind: 1 = points, 2 = range image
"""

from __future__ import annotations

import struct
from typing import Literal

import numpy as np

from ..errors import InvalidOption, InvalidScan, MalformedData, TooLarge, UnsupportedFormat
from ..scan.scan import MAX_ABS_COORDINATE_M, MAX_POINTS, Scan
from ..scan.voxel_filter import first_in_voxel
from . import points as wire_points
from . import range_image as wire_range_image

MEDIA_TYPE = "application/vnd.firstfix.scan"
MAGIC = b"FFSC"
VERSION = 1
KIND_POINTS, KIND_RANGE_IMAGE = 1, 2

ScanForm = Literal["points", "range_image"]

_PREFIX = struct.Struct("<4sBB")


def encode_scan(
    scan: Scan,
    *,
    form: ScanForm = "points",
    resolution_m: float | None = None,
    voxel_m: float | None = None,
) -> bytes:
    """The scan's bytes. Points come back as the form's module says.

    Args:
        resolution_m: step of coordinates or of ranges; None: 0.01 of points, 0.025 of a range image.
        voxel_m: when given, only the first point of each cube of this side is sent.

    Raises:
        InvalidOption: no such form; a resolution outside 0.0001..1 m (points) or 0.005..1 m (a range image),
            or a voxel outside 0.01..10 m.
        InvalidScan: a coordinate that is not finite or beyond MAX_ABS_COORDINATE_M.
        TooLarge: over MAX_POINTS points.
    """
    if form not in ("points", "range_image"):
        raise InvalidOption(f"a scan has the form points or range_image, not {form!r}")
    if voxel_m is not None and not 0.01 <= voxel_m <= 10:
        raise InvalidOption("voxel_m must lie in [0.01, 10]")
    if len(scan) > MAX_POINTS:
        raise TooLarge(f"the scan has {len(scan)} points, the limit is {MAX_POINTS}")
    furthest_m = float(np.abs(scan.points).max(initial=0))
    if not furthest_m <= MAX_ABS_COORDINATE_M:
        raise InvalidScan(f"a coordinate of {furthest_m} m cannot be sent; see Scan.from_points")
    if voxel_m is not None:
        kept = first_in_voxel(scan.points, voxel_m)
        intensity = None if scan.intensity is None else scan.intensity[kept]
        scan = Scan(scan.points[kept], intensity, scan.stamp_s)
    if form == "points":
        rest = wire_points.encode(scan, 0.01 if resolution_m is None else resolution_m)
        return _PREFIX.pack(MAGIC, VERSION, KIND_POINTS) + rest
    rest = wire_range_image.encode(scan, 0.025 if resolution_m is None else resolution_m)
    return _PREFIX.pack(MAGIC, VERSION, KIND_RANGE_IMAGE) + rest


def decode_scan(body: bytes) -> Scan:
    """The scan of ``encode_scan``'s bytes. Every size is checked before memory is taken for it.

    Raises:
        MalformedData: not this format, or bytes that contradict their header.
        UnsupportedFormat: a later version or another kind of this format.
        TooLarge: over MAX_POINTS points.
    """
    if len(body) < _PREFIX.size:
        raise MalformedData(f"{len(body)} bytes are too few for {MEDIA_TYPE}")
    magic, version, kind = _PREFIX.unpack_from(body)
    if magic != MAGIC:
        raise MalformedData(f"not {MEDIA_TYPE}: it begins with {magic!r}, not {MAGIC!r}")
    if version != VERSION or kind not in (KIND_POINTS, KIND_RANGE_IMAGE):
        raise UnsupportedFormat(f"{MEDIA_TYPE} version {version} kind {kind}; this reads 1 and 1 or 2")
    decode = wire_points.decode if kind == KIND_POINTS else wire_range_image.decode
    scan = decode(memoryview(body)[_PREFIX.size :])
    if not float(np.abs(scan.points).max(initial=0)) <= MAX_ABS_COORDINATE_M * 1.001:
        raise MalformedData(f"the scan has coordinates beyond {MAX_ABS_COORDINATE_M:g} m")
    return scan
