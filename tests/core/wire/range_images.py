"""Range images for tests: a sweep, and a writer that is independent of the encoder."""

from __future__ import annotations

import struct

import numpy as np
import zstandard

from firstfix.scan.scan import Scan
from firstfix.wire.scan import encode_scan


def image_of(scan: Scan, resolution_m: float | None = None) -> bytes:
    return encode_scan(scan, form="range_image", resolution_m=resolution_m)


def spinning(columns: int = 300, seed: int = 0) -> Scan:
    """A sweep of sixteen beams, with jumps of metres between neighbours and gaps of all sizes."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, columns, endpoint=False), np.radians(np.linspace(-15, 15, 16))
    )
    ranges = 20 + 9 * np.sign(np.sin(7 * azimuth)) + rng.normal(0, 0.02, azimuth.shape)
    across = ranges * np.cos(elevation)
    points = np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), ranges * np.sin(elevation)], axis=-1
    )
    points = points.reshape(-1, 3)[rng.random(azimuth.size) < 0.8]
    return Scan.from_points(points, None, 1_700_000_000.25)


def body_of(
    columns: int, rows: int, halves: list[int], gaps: list[int], ranges: list[int], wide: list[int]
) -> bytes:
    """An independent writer, from the layout in the module's docstring."""
    packed = [high << 4 | low for high, low in zip(halves[::2], [*halves[1::2], 0], strict=False)]
    first = bytes(packed) + b"".join(bytes(gap >> shift & 255 for gap in gaps) for shift in (0, 8, 16))
    second = bytes(ranges) + b"".join(bytes(number >> shift & 255 for number in wide) for shift in (0, 8))
    frame = zstandard.ZstdCompressor(level=7).compress(first)
    header = struct.pack("<4sBBHIHHddI", b"FFSC", 1, 2, columns, len(ranges), rows, 0, 0.5, 7.5, len(frame))
    return header + frame + zstandard.ZstdCompressor(level=7).compress(second)
