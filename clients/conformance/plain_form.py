"""The plain form of a body: its content without compression.

Two versions of zstd may compress the same content to different bytes. In the plain form, every zstd frame is
replaced by its content, and every field with the length of a frame is 0 (README.md in this folder).
"""

from __future__ import annotations

import struct

import zstandard


def plain_form(body: bytes) -> bytes:
    """Returns the plain form of a valid ``FFSC``, ``FFQY`` or ``FFSS`` body."""
    return {b"FFSC": _scan, b"FFQY": _query, b"FFSS": _scans}[body[:4]](body)


def _scan(body: bytes) -> bytes:
    plain, rest = body[:6], body[6:]
    if body[5] > 4:
        times, rest = _times(rest)
        plain += times
    if body[5] % 4 == 1:
        return plain + rest[:58] + zstandard.decompress(rest[58:])
    end = 30 + struct.unpack_from("<I", rest, 26)[0]
    return (
        plain + rest[:26] + bytes(4) + zstandard.decompress(rest[30:end]) + zstandard.decompress(rest[end:])
    )


def _times(rest: bytes) -> tuple[bytes, bytes]:
    """Plain form of the times of points, and what follows them."""
    end = 12 + struct.unpack_from("<I", rest, 8)[0]
    return rest[:8] + bytes(4) + zstandard.decompress(rest[12:end]), rest[end:]


def _query(body: bytes) -> bytes:
    plain, at = body[:8], 8
    if body[5] & 1:
        count, first, second = (struct.unpack_from("<H", body, at + offset)[0] for offset in (4, 18, 20))
        low_bytes = 3 * -(-count // 2)
        plain += body[at : at + 18] + bytes(4)
        at += 22
        for length in (first, second):
            plain += zstandard.decompress(body[at : at + length])
            at += length
        plain += body[at : at + low_bytes]
        at += low_bytes
    if body[5] & 2:
        head = at + 32 + 4 * body[at + 1]
        end = head + struct.unpack_from("<H", body, at + 6)[0]
        plain += body[at : at + 6] + bytes(2) + body[at + 8 : head] + zstandard.decompress(body[head:end])
        at = end
    if body[5] & 4:
        plain += _times(body[at:])[0]
    return plain


def _scans(body: bytes) -> bytes:
    plain, at = body[:8], 8
    for _ in range(body[5]):
        length = struct.unpack_from("<I", body, at + 56)[0]
        plain += body[at : at + 56] + bytes(4) + plain_form(body[at + 60 : at + 60 + length])
        at += 60 + length
    return plain
