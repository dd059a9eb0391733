"""Scans and bodies for tests of the encodings."""

from __future__ import annotations

import struct

import numpy as np
import zstandard

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.scan.compact import CompactScan, ScanDescriptor
from firstfix.scan.reduction import COLUMNS, ROWS
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix.wire.scan import encode_scan
from firstfix.wire.sequence import encode_scans


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


def street_scan(seed: int = 0, n: int = 5000) -> Scan:
    rng = np.random.default_rng(seed)
    azimuth = np.sort(rng.uniform(-np.pi, np.pi, n))
    ranges = 20 + 5 * np.sin(4 * azimuth) + rng.normal(0, 0.02, n)
    points = np.stack([ranges * np.cos(azimuth), ranges * np.sin(azimuth), rng.uniform(-2, 5, n)], axis=1)
    return Scan.from_points(points, rng.integers(0, 256, n), 1_700_000_000.25)


def described(
    rings: int = 20, edges_m: tuple[float, ...] = (0.3, 1.0, 1.8, 3.0, 6.0, 25.0)
) -> ScanDescriptor:
    rng = np.random.default_rng(1)
    descriptor = LayeredOccupancy(PolarGrid(rings, 60, 23.7), edges_m)
    bits = rng.random(descriptor.rows * 60) < 0.1
    return ScanDescriptor(descriptor, np.packbits(bits), np.array([0.0, 0.6, 0.8]), 1.73)


def compact(n: int = 400, seed: int = 0) -> CompactScan:
    """A compact scan of whole numbers, so that the bytes are the same on every machine."""
    rng = np.random.default_rng(seed)
    points = rng.integers(-2000, 2000, (n, 3)) * 0.02
    nearest_m = np.full(ROWS * COLUMNS, np.inf, np.float32)
    nearest_m[2000:5000] = rng.integers(1, 60, 3000)
    return CompactScan(points.astype(np.float32), nearest_m, described())


_RNG = np.random.default_rng(0)
SCANS = [Scan(_RNG.uniform(-20, 20, (50 + 10 * n, 3)).astype(np.float32), None, 5.0 + n) for n in range(3)]
WAY = [make_transform(rotation_z(0.2 * n), [n, 0.1 * n, 0]) for n in range(3)]
SEQUENCE = encode_scans(SCANS, WAY)
