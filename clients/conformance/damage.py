"""Bodies that contradict their format. Every reader refuses them before it allocates memory."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator
from typing import Any

import zstandard

from .files import reference

Vector = dict[str, Any]
Damaged = tuple[str, str, bytes]  # name, code of the error, body


def _with(body: bytes, at: int, form: str, *values: Any) -> bytes:
    changed = bytearray(body)
    struct.pack_into("<" + form, changed, at, *values)
    return bytes(changed)


def _undeclared(content: bytes) -> bytes:
    return zstandard.ZstdCompressor(write_content_size=False).compress(content)


def damaged_scans(good: bytes) -> Iterator[Damaged]:
    """Damages a valid scan of more than 2 points without intensity."""
    count = struct.unpack_from("<I", good, 8)[0]
    content = zstandard.decompress(good[64:])
    yield "nothing", "malformed_data", b""
    yield "a-header-cut-off", "malformed_data", good[:63]
    yield "a-frame-cut-off", "malformed_data", good[:-1]
    yield "bytes-after-it", "malformed_data", good + b"\0"
    yield "another-magic", "malformed_data", b"FFSD" + good[4:]
    yield "a-later-version", "unsupported_format", _with(good, 4, "B", 2)
    yield "another-kind", "unsupported_format", _with(good, 5, "B", 3)
    yield "a-range-images-kind", "malformed_data", _with(good, 5, "B", 2)
    yield "three-bytes-a-coordinate", "malformed_data", _with(good, 6, "B", 3)
    yield "three-bytes-an-intensity", "malformed_data", _with(good, 7, "B", 3)
    yield "another-count", "malformed_data", _with(good, 8, "I", count + 1)
    yield "two-million-points-and-one", "too_large", _with(good, 8, "I", 2_000_001)
    yield "two-million-points", "malformed_data", _with(good, 8, "I", 2_000_000)
    yield "a-reserved-field", "malformed_data", _with(good, 12, "I", 1)
    for name, value in (("zero", 0.0), ("not-a-number", math.nan), ("two-metres", 2.0)):
        yield f"a-resolution-of-{name}", "malformed_data", _with(good, 16, "d", value)
    yield "an-origin-too-far", "malformed_data", _with(good, 32, "d", -1001.0)
    yield "an-origin-not-a-number", "malformed_data", _with(good, 24, "d", math.nan)
    yield "an-infinite-stamp", "malformed_data", _with(good, 48, "d", math.inf)
    yield "an-infinite-scale", "malformed_data", _with(good, 56, "f", math.inf)
    yield "points-too-far", "malformed_data", _with(_with(good, 24, "d", 990.0), 16, "d", 1.0)
    yield "a-frame-of-undeclared-size", "malformed_data", good[:64] + _undeclared(content)
    yield "another-checksum", "malformed_data", good[:-1] + bytes([good[-1] ^ 1])
    yield "a-frame-of-noise", "malformed_data", good[:64] + bytes(range(1, 60))
    yield "two-frames", "malformed_data", good + good[64:]


def damaged_range_images(good: bytes) -> Iterator[Damaged]:
    """Damages a valid range image with an odd number of returns, wide gaps and wide ranges."""
    count, length = (struct.unpack_from("<I", good, at)[0] for at in (8, 32))
    halves = (count + 1) // 2
    gaps, ranges = (zstandard.decompress(frame) for frame in (good[36 : 36 + length], good[36 + length :]))

    def of(gaps: bytes, ranges: bytes) -> bytes:
        first = zstandard.compress(gaps)
        return _with(good[:36], 32, "I", len(first)) + first + zstandard.compress(ranges)

    yield "image-header-cut-off", "malformed_data", good[:35]
    yield "image-frame-cut-off", "malformed_data", good[:-1]
    yield "image-bytes-after-it", "malformed_data", good + b"\0"
    yield "image-two-million-points-and-one", "too_large", _with(good, 8, "I", 2_000_001)
    yield "image-two-million-points", "malformed_data", _with(good, 8, "I", 2_000_000)
    yield "image-one-more", "malformed_data", _with(good, 8, "I", count + 1)
    yield "image-three-columns", "malformed_data", _with(good, 6, "H", 3)
    yield "image-one-row", "malformed_data", _with(good, 12, "H", 1)
    yield "image-of-too-many-cells", "malformed_data", _with(good, 12, "H", 4097)
    yield "image-of-too-few-cells", "malformed_data", _with(good, 12, "H", 512)
    yield "image-a-reserved-field", "malformed_data", _with(good, 14, "H", 1)
    for name, value in (("too-fine", 0.0049), ("not-a-number", math.nan), ("two-metres", 2.0)):
        yield f"image-resolution-{name}", "malformed_data", _with(good, 16, "d", value)
    yield "image-infinite-stamp", "malformed_data", _with(good, 24, "d", -math.inf)
    yield "image-frame-too-long", "malformed_data", _with(good, 32, "I", 0xFFFFFFFF)
    yield "image-frame-of-no-bytes", "malformed_data", _with(good, 32, "I", 0)
    yield "image-too-far", "malformed_data", _with(good, 16, "d", 1.0)
    yield "image-a-wide-gap-missing", "malformed_data", of(gaps[:-3], ranges)
    yield "image-a-byte-of-a-gap-missing", "malformed_data", of(gaps[:-1], ranges)
    yield "image-a-wide-gap-too-many", "malformed_data", of(gaps + bytes(3), ranges)
    yield "image-a-wide-range-missing", "malformed_data", of(gaps, ranges[:-2])
    yield "image-a-wide-range-too-many", "malformed_data", of(gaps, ranges + bytes(2))
    yield "image-beyond-its-grid", "malformed_data", of(_widest(gaps, halves), ranges)
    yield (
        "image-half-a-byte-set",
        "malformed_data",
        of(_with(gaps, halves - 1, "B", gaps[halves - 1] | 1), ranges),
    )
    yield "image-a-range-of-zero", "malformed_data", of(gaps, bytes([0]) + ranges[1:])
    yield "image-ranges-of-undeclared-size", "malformed_data", good[: 36 + length] + _undeclared(ranges)
    yield "image-frames-swapped", "malformed_data", of(ranges, gaps)


def damaged_times(good: bytes, at: int) -> Iterator[Damaged]:
    """Damages the times of the points of a valid scan or compact query, which begin at an offset."""
    (length,) = struct.unpack_from("<I", good, at + 8)
    end = at + 12 + length
    levels = zstandard.decompress(good[at + 12 : end])

    def of(frame: bytes) -> bytes:
        return _with(good[: at + 12], at + 8, "I", len(frame)) + frame + good[end:]

    for name, value in (("too-early", -1.01), ("not-a-number", math.nan), ("infinite", math.inf)):
        yield f"times-{name}", "malformed_data", _with(good, at, "f", value)
    for name, value in (("below-zero", -1e-4), ("not-a-number", math.nan), ("of-two-seconds", 2.0)):
        yield f"times-a-step-{name}", "malformed_data", _with(good, at + 4, "f", value)
    yield "times-cut-off", "malformed_data", good[: at + 13]
    yield "times-frame-too-long", "malformed_data", _with(good, at + 8, "I", 0xFFFFFFFF)
    yield "times-frame-of-no-bytes", "malformed_data", of(b"")
    yield "times-one-missing", "malformed_data", of(zstandard.compress(levels[:-1]))
    yield "times-one-too-many", "malformed_data", of(zstandard.compress(levels + bytes(1)))
    yield "times-of-two-million-points", "malformed_data", of(zstandard.compress(bytes(2_000_000)))
    yield "times-of-undeclared-size", "malformed_data", of(_undeclared(levels))
    yield "times-of-noise", "malformed_data", of(bytes(range(1, 40)))


def _widest(gaps: bytes, halves: int) -> bytes:
    """Gaps with all wide ones at their largest value."""
    return gaps[:halves] + bytes([255]) * (len(gaps) - halves)


def damaged_queries(compact: bytes, described: bytes) -> Iterator[Damaged]:
    """Damages a valid compact scan and a valid descriptor."""
    yield "nothing", "malformed_data", b""
    yield "another-magic", "malformed_data", b"FFQX" + compact[4:]
    yield "a-later-version", "unsupported_format", _with(compact, 4, "B", 2)
    yield "no-parts", "unsupported_format", _with(compact, 5, "B", 0)
    yield "four-parts", "unsupported_format", _with(compact, 5, "B", 4)
    yield "a-reserved-field", "malformed_data", _with(compact, 6, "H", 1)
    yield "a-part-missing", "malformed_data", _with(compact, 5, "B", 3)
    yield "bytes-after-it", "malformed_data", compact + b"\0"
    yield "a-point-cut-off", "malformed_data", compact[:-1]
    yield "a-resolution-too-fine", "malformed_data", _with(compact, 8, "f", 0.001)
    yield "a-resolution-not-a-number", "malformed_data", _with(compact, 8, "f", math.nan)
    yield "too-many-points", "too_large", _with(compact, 12, "H", 10_001)
    yield "another-count", "malformed_data", _with(compact, 12, "H", 10_000)
    yield "no-cells", "malformed_data", _with(compact, 20, "H", 0)
    yield "too-many-cells", "malformed_data", _with(compact, 20, "3H", 65_535, 65_535, 2)
    yield "points-beyond-the-cells", "malformed_data", _with(compact, 20, "3H", 1, 1, 1)
    yield "points-too-far", "malformed_data", _with(compact, 14, "3h", 32_767, 32_767, 32_767)
    yield "a-frame-too-long", "malformed_data", _with(compact, 26, "H", 65_535)
    yield "a-frame-of-no-bytes", "malformed_data", _with(compact, 26, "H", 0)
    yield "ranges-of-other-directions", "malformed_data", _other_ranges(compact)
    yield "another-descriptor", "unsupported_format", _with(described, 8, "B", 2)
    yield "no-layers", "malformed_data", _with(described, 9, "B", 0)
    yield "seventeen-layers", "malformed_data", _with(described, 9, "B", 17)
    yield "no-rings", "malformed_data", _with(described, 10, "H", 0)
    yield "too-many-sectors", "malformed_data", _with(described, 12, "H", 721)
    yield "another-number-of-sectors", "malformed_data", _with(described, 12, "H", 720)
    yield "a-radius-of-zero", "malformed_data", _with(described, 16, "f", 0.0)
    yield "an-up-too-long", "malformed_data", _with(described, 20, "3f", 0.0, 1.0, 1.0)
    yield "an-up-not-a-number", "malformed_data", _with(described, 20, "f", math.nan)
    yield "a-height-too-high", "malformed_data", _with(described, 32, "f", 101.0)
    yield "layers-that-descend", "malformed_data", _with(described, 36, "2f", 2.0, 1.0)
    yield "an-infinite-layer", "malformed_data", _with(described, 36, "f", -math.inf)
    yield "a-descriptor-cut-off", "malformed_data", described[:-1]


def _other_ranges(compact: bytes) -> bytes:
    """Removes the last range."""
    first, second = struct.unpack_from("<HH", compact, 26)
    at = 30 + first
    frame = zstandard.compress(zstandard.decompress(compact[at : at + second])[:-1])
    return _with(compact[:at] + frame + compact[at + second :], 28, "H", len(frame))


def damaged_sequences(good: bytes, described: bytes) -> Iterator[Damaged]:
    """Damages a valid sequence. Also puts a valid descriptor into it, which is not allowed."""
    yield "nothing", "malformed_data", b""
    yield "another-magic", "malformed_data", b"FFSX" + good[4:]
    yield "a-later-version", "unsupported_format", _with(good, 4, "B", 2)
    yield "no-scans", "malformed_data", _with(good, 5, "B", 0)
    yield "without-any-scan", "invalid_scan", _with(good, 5, "B", 0)[:8]
    yield "too-many-scans", "too_large", _with(good, 5, "B", 17)
    yield "another-number-of-scans", "malformed_data", _with(good, 5, "B", good[5] + 1)
    yield "a-scan-cut-off", "malformed_data", good[:-1]
    yield "bytes-after-it", "malformed_data", good + b"\0"
    yield "a-scan-too-long", "malformed_data", _with(good, 64, "I", 0xFFFFFFFF)
    yield "a-quaternion-of-zero", "invalid_scan", _with(good, 32, "4d", 0, 0, 0, 0)
    yield "a-pose-not-a-number", "invalid_scan", _with(good, 8, "d", math.nan)
    alone = _with(good[:68], 5, "B", 1)
    yield "a-descriptor-alone", "malformed_data", _with(alone, 64, "I", len(described)) + described


def vectors(kind: str, damaged: Iterable[Damaged], what: str = "") -> tuple[list[Vector], dict[str, bytes]]:
    """Vectors of ``decode_<kind>``, and the bodies by name.

    Args:
        what: stands before each name.
    """
    index: list[Vector] = []
    bodies: dict[str, bytes] = {}
    for case, code, body in damaged:
        name = what + case
        bodies[f"{kind}-{name}"] = body
        index.append(
            {
                "name": f"damaged-{kind}-{name}",
                "function": f"decode_{kind}",
                "input": {"body": reference(f"{kind}-{name}")},
                "expected": {"error": code},
            }
        )
    return index, bodies
