"""Decompression of request bodies (Content-Encoding) with a bounded size."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import zstandard

from ..errors import MalformedData, TooLarge, UnsupportedFormat

# Small slices bound the output of one step. A zstd block of 4 bytes can expand to 128 KiB, so a slice to
# 32 MiB. Deflate expands one byte to at most 1032 bytes, so a slice to 8 MiB.
_ZSTD_SLICE_BYTES = 1024
_GZIP_SLICE_BYTES = 8192
_ZSTD_MAX_WINDOW_BYTES = 1 << 23  # RFC 8878 requires every decoder to support it


def undo_content_encoding(body: bytes | memoryview, encoding: str, max_bytes: int) -> bytes | memoryview:
    """Returns the body as it was before the encoding.

    Args:
        encoding: value of the header: gzip, zstd, identity or empty.
        max_bytes: limit of the result.

    Raises:
        TooLarge: the result would be longer. The declared size of a zstd frame is checked before any work.
        MalformedData: damaged, cut off, or followed by other bytes.
        UnsupportedFormat: as ``decompressor_of``.
    """
    return decompressor_of(encoding)(body, max_bytes)


def decompressor_of(encoding: str) -> Callable[[bytes | memoryview, int], bytes | memoryview]:
    """Returns the function that undoes an encoding: of a body, up to so many bytes. It can be pickled.

    Raises:
        UnsupportedFormat: another encoding, or several.
    """
    name = encoding.strip().lower()
    if name in ("", "identity"):
        return _identity
    if name in ("gzip", "x-gzip"):
        return _gunzip
    if name == "zstd":
        return _unzstd
    raise UnsupportedFormat(f"unknown Content-Encoding {encoding[:40]!r}: use gzip, zstd or identity")


def _identity(body: bytes | memoryview, max_bytes: int) -> bytes | memoryview:
    if len(body) > max_bytes:
        raise TooLarge(f"the body has {len(body)} bytes, the limit is {max_bytes}")
    return body


def _gunzip(body: bytes | memoryview, max_bytes: int) -> bytes:
    stream = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)  # 16: a gzip header
    try:
        return _expanded("gzip", stream, body, _GZIP_SLICE_BYTES, max_bytes)
    except zlib.error as error:
        raise MalformedData(f"gzip: {error}") from error


def _unzstd(body: bytes | memoryview, max_bytes: int) -> bytes:
    try:
        declared = zstandard.frame_content_size(body)  # -1: not declared
        _check_size("zstd", declared, max_bytes)
        stream = zstandard.ZstdDecompressor(max_window_size=_ZSTD_MAX_WINDOW_BYTES).decompressobj()
        return _expanded("zstd", stream, body, _ZSTD_SLICE_BYTES, max_bytes)
    except zstandard.ZstdError as error:
        raise MalformedData(f"zstd: {error}") from error


def _expanded(name: str, stream: Any, body: bytes | memoryview, slice_bytes: int, max_bytes: int) -> bytes:
    """Decompresses slice after slice and checks the size after each."""
    parts, size = [], 0
    for start in range(0, len(body), slice_bytes):
        parts.append(stream.decompress(body[start : start + slice_bytes]))
        size += len(parts[-1])
        _check_size(name, size, max_bytes)
        if stream.eof:
            if stream.unused_data or start + slice_bytes < len(body):
                raise MalformedData(f"{name}: other bytes follow the compressed data")
            return b"".join(parts)
    raise MalformedData(f"{name}: the data is cut off")


def _check_size(name: str, size: int, max_bytes: int) -> None:
    if size > max_bytes:
        raise TooLarge(f"{name}: the body expands to over {max_bytes} bytes")
