"""Decompression of request bodies (Content-Encoding) with a bounded size."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import zstandard

from ..errors import MalformedData, TooLarge, UnsupportedFormat

# Small slices bound the output of one step. A zstd block of 4 bytes can expand to 128 KiB, so a slice to
# 32 MiB. Deflate expands one byte to at most 1032 bytes, so a slice to 8 MiB.
ZSTD_SLICE_BYTES = 1024
_GZIP_SLICE_BYTES = 8192
_ZSTD_MAX_WINDOW_BYTES = 1 << 23  # RFC 8878 requires every decoder to support it


def undo_content_encoding(body: bytes | memoryview, encoding: str, max_bytes: int) -> bytes | memoryview:
    """The body as it was before the encoding.

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
    """The function that undoes an encoding: of a body, up to so many bytes. It can be pickled.

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
        return b"".join(_expanded("gzip", stream, _slices(body, _GZIP_SLICE_BYTES), max_bytes))
    except zlib.error as error:
        raise MalformedData(f"gzip: {error}") from error


def _unzstd(body: bytes | memoryview, max_bytes: int) -> bytes:
    return unpack_zstd(body, max_bytes, _ZSTD_MAX_WINDOW_BYTES)


def unpack_zstd(body: bytes | memoryview, max_bytes: int, max_window_bytes: int) -> bytes:
    """The content of one zstd frame.

    Args:
        max_window_bytes: limit of the memory that the frame may ask for beside its content.

    Raises:
        TooLarge, MalformedData: as ``undo_content_encoding``.
    """
    try:
        declared = zstandard.frame_content_size(body)  # -1: not declared
    except zstandard.ZstdError as error:
        raise MalformedData(f"zstd: {error}") from error
    _check_size("zstd", declared, max_bytes)
    return b"".join(unpacked_zstd(_slices(body, ZSTD_SLICE_BYTES), max_bytes, max_window_bytes))


def unpacked_zstd(
    slices: Iterable[bytes | memoryview], max_bytes: int, max_window_bytes: int
) -> Iterator[bytes]:
    """Yield the content of one zstd frame piece by piece.

    Args:
        slices: the frame in slices of up to ZSTD_SLICE_BYTES, so that no piece is large.

    Raises:
        TooLarge, MalformedData: as ``undo_content_encoding``.
    """
    stream = zstandard.ZstdDecompressor(max_window_size=max_window_bytes).decompressobj()
    try:
        yield from _expanded("zstd", stream, slices, max_bytes)
    except zstandard.ZstdError as error:
        raise MalformedData(f"zstd: {error}") from error


def _slices(body: bytes | memoryview, size: int) -> Iterator[bytes | memoryview]:
    return (body[start : start + size] for start in range(0, len(body), size))


def _expanded(
    name: str, stream: Any, slices: Iterable[bytes | memoryview], max_bytes: int
) -> Iterator[bytes]:
    """Decompresses slice after slice and checks the size after each."""
    size = 0
    for piece in slices:
        if stream.eof:
            raise MalformedData(f"{name}: other bytes follow the compressed data")
        part = stream.decompress(piece)
        size += len(part)
        _check_size(name, size, max_bytes)
        if stream.eof and stream.unused_data:
            raise MalformedData(f"{name}: other bytes follow the compressed data")
        yield part
    if not stream.eof:
        raise MalformedData(f"{name}: the data is cut off")


def _check_size(name: str, size: int, max_bytes: int) -> None:
    if size > max_bytes:
        raise TooLarge(f"{name}: the body expands to over {max_bytes} bytes")
