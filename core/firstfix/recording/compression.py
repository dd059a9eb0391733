"""Compression of bags, with limits: a small file cannot take memory or disk without limit.

rosbag2 compresses whole files or single messages with zstd. mcap and ROS 1 compress chunks of messages.
"""

from __future__ import annotations

import bz2
from pathlib import Path
from typing import Any

from ..errors import MalformedData, TooLarge
from ..wire.content_encoding import ZSTD_SLICE_BYTES, unpack_zstd, unpacked_zstd
from .messages import MAX_CHUNK_BYTES, MAX_MESSAGE_BYTES

_MAX_WINDOW_BYTES = 1 << 27  # as the program zstd allows
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no message begins with it: CDR begins with a zero byte
_PIECE_BYTES = 1 << 20


def unpack_message(body: bytes | memoryview) -> bytes | memoryview:
    """A message of a ROS 2 bag as it was before compression; one without compression as it is.

    Raises:
        TooLarge: it has over MAX_MESSAGE_BYTES.
        MalformedData: the compressed data is damaged or cut off.
    """
    if body[:4] != _ZSTD_MAGIC:
        return body
    return unpack_zstd(body, MAX_MESSAGE_BYTES, MAX_MESSAGE_BYTES)


def unpack_file(source: Path, folder: Path, max_bytes: int) -> Path:
    """Unpack a file into a folder.

    Returns:
        Its path, without the ending of the compression.

    Raises:
        TooLarge: it has over so many bytes.
        MalformedData: it is damaged or cut off.
    """
    target = folder / source.stem
    with source.open("rb") as packed, target.open("wb") as out:
        slices = iter(lambda: packed.read(ZSTD_SLICE_BYTES), b"")
        try:
            for piece in unpacked_zstd(slices, max_bytes, _MAX_WINDOW_BYTES):
                out.write(piece)
        except TooLarge as error:
            raise TooLarge(
                f"{source.name} unpacks to over {max_bytes} bytes, half of the free space in "
                f"{folder.parent}: name another folder in TMPDIR"
            ) from error
        except MalformedData as error:
            raise MalformedData(f"{source.name}: {error}") from error
    return target


def unpack_chunk(name: str, data: bytes, size: int) -> bytes:
    """A chunk of an mcap file as it was before compression.

    Args:
        name: of the compression: ``zstd``, ``lz4`` or empty.
        size: that the chunk declares.

    Raises:
        TooLarge: it declares, or has, over MAX_CHUNK_BYTES.
        MalformedData: damaged, cut off, or of another compression.
    """
    if size > MAX_CHUNK_BYTES:
        raise TooLarge(f"a chunk has {size} bytes, the limit is {MAX_CHUNK_BYTES}")
    if name == "zstd":
        return unpack_zstd(data, size, MAX_CHUNK_BYTES)
    if name == "lz4":
        return _unpacked("lz4", _lz4(), data, size)
    if name:
        raise MalformedData(f"a chunk with an unknown compression {name[:40]!r}")
    return data


def limit_ros1_chunks() -> None:
    """Put decompressors with limits in the place of those of rosbags, which have none."""
    from rosbags.rosbag1 import reader

    reader.bz2_decompress, reader.lz4_decompress = _ros1_bz2, _ros1_lz4  # 0.9 makes its table of these names
    getattr(reader, "decompressors", {}).update(bz2=_ros1_bz2, lz4=_ros1_lz4)


def _ros1_bz2(data: bytes) -> bytes:
    return _unpacked("bz2", bz2.BZ2Decompressor(), data, MAX_CHUNK_BYTES)


def _ros1_lz4(data: bytes) -> bytes:
    return _unpacked("lz4", _lz4(), data, MAX_CHUNK_BYTES)


def _lz4() -> Any:
    import lz4.frame  # rosbags needs it too

    return lz4.frame.LZ4FrameDecompressor()


def _unpacked(name: str, stream: Any, data: bytes, max_bytes: int) -> bytes:
    parts, size = [], 0
    while not stream.eof:
        part = stream.decompress(data, max_length=_PIECE_BYTES)
        data = b""  # the stream keeps what it has not used
        if not part and stream.needs_input and not stream.eof:
            raise MalformedData(f"{name}: the data is cut off")
        parts.append(part)
        size += len(part)
        if size > max_bytes:
            raise TooLarge(f"{name}: a chunk expands to over {max_bytes} bytes")
    return b"".join(parts)
