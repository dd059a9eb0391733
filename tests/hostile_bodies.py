"""Query bodies of strangers: good ones of every encoding, damaged ones, and some that ask for trouble."""

from __future__ import annotations

import gzip
import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import zstandard
from numpy.typing import NDArray

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.ros.media_types import NAMES as POINT_CLOUDS
from firstfix.scan.condense import condense
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix.wire import sequence as wire_sequence
from tests.ros_bodies import point_cloud2
from tests.wounds import FLOATS, wounded


@dataclass(frozen=True)
class Body:
    """One query's body.

    Attributes:
        statuses: HTTP statuses that are right for it; empty: any that blames no defect of the service.
    """

    name: str
    data: bytes
    media_type: str
    content_encoding: str | None = None
    statuses: frozenset[int] = frozenset()


def good_bodies(points: int = 60, seed: int = 0) -> list[Body]:
    """One or more of every media type and content encoding."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-20, 20, (points, 3)).astype("<f4")
    levels = rng.uniform(0, 255, (points, 1)).astype("<f4")
    xyzi = np.hstack([xyz, levels])
    scan = Scan(xyz, levels[:, 0])
    sequence = wire_sequence.encode_scans([scan] * 3, [np.eye(4)] * 3)
    compact = condense(scan, DescriptorParameters(descriptor=LayeredOccupancy(PolarGrid())))
    raw = "application/vnd.firstfix.xyz"
    ok = frozenset({200})
    return [
        Body("scan", wire.encode_scan(scan), wire.MEDIA_TYPE, statuses=ok),
        Body("range image", wire.encode_scan(scan, form="range_image"), wire.MEDIA_TYPE, statuses=ok),
        Body("scans", sequence, wire_sequence.MEDIA_TYPE, statuses=ok),
        Body("query", wire_query.encode_query(compact), wire_query.MEDIA_TYPE, statuses=ok),
        Body("xyz", xyz.tobytes(), raw, statuses=ok),
        Body("xyzi", xyzi.tobytes(), "application/vnd.firstfix.xyzi", statuses=ok),
        Body("pcd ascii", pcd(xyz, "ascii"), "application/x-pcd", statuses=ok),
        Body("pcd binary", pcd(xyz, "binary"), "application/x-pcd", statuses=ok),
        Body("pcd compressed", pcd(xyz, "binary_compressed"), "model/vnd.pcd", statuses=ok),
        Body("ply ascii", ply(xyz, "ascii"), "application/ply", statuses=ok),
        Body("ply binary", ply(xyz, "binary_little_endian"), "model/ply", statuses=ok),
        *(Body(name, point_cloud2(xyz), name, statuses=ok) for name in POINT_CLOUDS),
        Body("npy", npy(xyzi), "application/x-npy", statuses=ok),
        Body("csv", rows(xyzi, ","), "text/csv", statuses=ok),
        Body("text", rows(xyz, " "), "text/plain", statuses=ok),
        Body("gzip", gzip.compress(xyz.tobytes()), raw, "gzip", ok),
        Body("zstd", zstandard.ZstdCompressor().compress(xyz.tobytes()), raw, "zstd", ok),
    ]


def npy(array: NDArray[np.generic]) -> bytes:
    """The array as an .npy file."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def rows(points: NDArray[np.float32], delimiter: str) -> bytes:
    """The points as rows of text."""
    file = io.BytesIO()
    np.savetxt(file, points, fmt="%.6f", delimiter=delimiter)
    return file.getvalue()


def damaged(body: Body, rng: np.random.Generator) -> Body:
    """The body with one to six random wounds."""
    return replace(body, name=f"damaged {body.name}", data=wounded(body.data, rng), statuses=frozenset())


def crafted_bodies() -> Iterator[Body]:
    """Well-formed, or nearly, and of a kind that has hurt others: made one by one, as some are large."""
    raw = "application/vnd.firstfix.xyz"
    bad, large, fine = frozenset({400, 422}), frozenset({413}), frozenset({200, 422})
    rng = np.random.default_rng(7)
    for value in FLOATS:
        mixed = rng.uniform(-20, 20, (1000, 3)).astype("<f4")
        mixed[::7, rng.integers(3)] = value
        yield Body(f"some {value}", mixed.tobytes(), raw, statuses=fine)
        yield Body(f"all {value}", np.full((1000, 3), value, "<f4").tobytes(), raw, statuses=fine)
        text = f"{value} {value} {value}\n" * 10
        yield Body(
            f"ascii {value}", _pcd_header(10, "ascii") + text.encode(), "application/x-pcd", statuses=fine
        )
    for count in (0, 1, 2, 100_000, 300_000):
        cloud = rng.uniform(-40, 40, (count, 3)).astype("<f4")
        yield Body(f"{count} points", cloud.tobytes(), raw, statuses=fine | bad)
        scan = wire.encode_scan(Scan(cloud))
        yield Body(f"{count} points encoded", scan, wire.MEDIA_TYPE, statuses=fine | bad)
        image = wire.encode_scan(Scan(cloud), form="range_image")
        yield Body(f"{count} points as a range image", image, wire.MEDIA_TYPE, statuses=fine | bad)
        yield Body(f"{count} points in PCD", pcd(cloud, "binary"), "application/x-pcd", statuses=fine | bad)
    yield Body("one point many times", np.full((200_000, 3), 3.0, "<f4").tobytes(), raw, statuses=fine)
    yield Body("too many points", bytes(2_000_001 * 12), raw, statuses=large)
    promise = _pcd_header(4_000_000_000, "binary") + bytes(100)
    yield Body("a PCD that promises", promise, "application/x-pcd", statuses=bad | large)
    promise = _ply_header(4_000_000_000, "binary_little_endian") + bytes(100)
    yield Body("a PLY that promises", promise, "application/ply", statuses=bad | large)
    sizes = struct.pack("<II", 20, 1_999_999 * 12)
    packed = _pcd_header(1_999_999, "binary_compressed") + sizes + bytes(20)
    yield Body("an LZF bomb", packed, "application/x-pcd", statuses=bad | large)
    yield from _bombs(raw, bad, large)


def _bombs(raw: str, bad: frozenset[int], large: frozenset[int]) -> Iterator[Body]:
    zeros = bytes(1 << 20)
    bomb = _gzip_of(zeros, 1024)
    yield Body("a gzip bomb", bomb, raw, "gzip", large)
    yield Body("a gzip bomb in gzip", gzip.compress(bomb), raw, "gzip", bad)
    small = gzip.compress(bytes(1200))
    yield Body("two gzip members", small + small, raw, "gzip", bad)
    yield Body("a gzip that lies of its size", small[:-4] + struct.pack("<I", 12), raw, "gzip", bad)
    silent = zstandard.ZstdCompressor(level=3, write_content_size=False).compressobj()
    stream = b"".join(silent.compress(zeros) for _ in range(1024)) + silent.flush()
    yield Body("a zstd bomb", stream, raw, "zstd", large)
    honest = zstandard.ZstdCompressor().compress(bytes(1200))
    yield Body("two zstd frames", honest + honest, raw, "zstd", bad)
    skippable = struct.pack("<II", 0x184D2A50, 1 << 31)
    yield Body("a zstd frame to skip", skippable + honest, raw, "zstd", bad | large)
    # a frame header: one segment, a content size of 8 bytes
    lie = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 1 << 62) + b"\x01\x00\x00"
    yield Body("a zstd frame that claims exabytes", lie, raw, "zstd", large)
    lie = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 12) + honest[9:]
    yield Body("a zstd frame that lies of its size", lie, raw, "zstd", bad)
    window = b"\x28\xb5\x2f\xfd\x00\xf8" + b"\x01\x00\x00"  # a window of terabytes
    yield Body("a zstd frame with a huge window", window, raw, "zstd", bad)
    count = 2_000_000
    frame = zstandard.ZstdCompressor().compress(bytes(6 * count))
    scan = wire.encode_scan(Scan(np.zeros((1, 3), np.float32)))
    head = scan[:8] + struct.pack("<I", count) + scan[12:64]
    gaps, ranges = (
        zstandard.compress(content) for content in (bytes(count // 2), bytes([8]) + bytes(count - 1))
    )
    shape = struct.pack("<4sBBHIHHddI", b"FFSC", 1, 2, 4096, count, 4096, 0, 1.0, 0.0, len(gaps))
    for name, bomb in (("scan", head + frame), ("range image", shape + gaps + ranges)):
        yield Body(f"a {name} that is a bomb", bomb, wire.MEDIA_TYPE, statuses=frozenset({200, 422}))
        entry = struct.pack("<7dI", 0, 0, 0, 0, 0, 0, 1, len(bomb)) + bomb
        bombs = struct.pack("<4sBBH", b"FFSS", 1, 16, 0) + entry * 16
        yield Body(f"sixteen bombs of a {name}", bombs, wire_sequence.MEDIA_TYPE, statuses=large)


def _gzip_of(block: bytes, count: int) -> bytes:
    """``gzip.compress(block * count)`` in a fraction of the time: the block is compressed once."""
    deflate = zlib.compressobj(wbits=-zlib.MAX_WBITS)
    compressed = deflate.compress(block) + deflate.flush(zlib.Z_FULL_FLUSH)  # refers to nothing before it
    checksum = 0
    for _ in range(count):
        checksum = zlib.crc32(block, checksum)
    trailer = struct.pack("<II", checksum, len(block) * count % (1 << 32))
    return gzip.compress(b"", mtime=0)[:10] + compressed * count + deflate.flush() + trailer


def _pcd_header(points: int, encoding: str) -> bytes:
    return (
        f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {points}\nHEIGHT 1\n"
        f"POINTS {points}\nDATA {encoding}\n"
    ).encode()


def pcd(xyz: NDArray[np.float32], encoding: str) -> bytes:
    header = _pcd_header(len(xyz), encoding)
    if encoding == "ascii":
        return header + _rows(xyz)
    if encoding == "binary":
        return header + xyz.tobytes()
    plain = np.ascontiguousarray(xyz.T).tobytes()
    # LZF without a match: runs of up to 32 bytes, each behind its length less one
    runs = [plain[start : start + 32] for start in range(0, len(plain), 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    return header + struct.pack("<II", len(packed), len(plain)) + packed


def _ply_header(points: int, encoding: str) -> bytes:
    lines = ["ply", f"format {encoding} 1.0", f"element vertex {points}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    return "\n".join([*lines, "end_header", ""]).encode()


def ply(xyz: NDArray[np.float32], encoding: str) -> bytes:
    return _ply_header(len(xyz), encoding) + (_rows(xyz) if encoding == "ascii" else xyz.tobytes())


def _rows(xyz: NDArray[np.float32]) -> bytes:
    return "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in xyz.tolist()).encode()
