"""Compression of bags, with limits: a small file cannot take memory or disk without limit.

rosbag2 compresses whole files or single messages with zstd. mcap and ROS 1 compress chunks of messages.
"""

from __future__ import annotations

import bz2
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import MalformedData, TooLarge
from ..formats.point_cloud import SCAN_LIMITS
from ..wire.content_encoding import ZSTD_SLICE_BYTES, unpack_zstd, unpacked_zstd

MAX_MESSAGE_BYTES = SCAN_LIMITS.max_decoded_bytes + 1_000_000  # a cloud with its header and field names
MAX_CHUNK_BYTES = 2 * MAX_MESSAGE_BYTES  # a recorder closes a chunk after the message that fills it
_MAX_WINDOW_BYTES = 1 << 27  # as the program zstd allows
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no message begins with it: CDR begins with a zero byte
_PIECE_BYTES = 1 << 20
_METADATA = "metadata.yaml"
_INFORMATION = "rosbag2_bagfile_information"


def unpack_message(body: bytes) -> bytes:
    """A message of a ROS 2 bag as it was before compression; one without compression as it is.

    Raises:
        TooLarge: it has over MAX_MESSAGE_BYTES.
        MalformedData: the compressed data is damaged or cut off.
    """
    if body[:4] != _ZSTD_MAGIC:
        return body
    return unpack_zstd(body, MAX_MESSAGE_BYTES, MAX_MESSAGE_BYTES)


@contextmanager
def unpack_files(path: Path) -> Iterator[Path]:
    """Give the path to open: a temporary copy if the files of a ROS 2 bag are compressed, else the path.

    Args:
        path: the bag's folder or its only file.

    Raises:
        TooLarge: the unpacked files take over half of the free space in the temporary folder.
        MalformedData: no valid ``metadata.yaml``, or a file is missing, damaged or cut off.
    """
    described = _described(path) if path.is_dir() else None
    if described is None and path.suffix != ".zstd":
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="firstfix-bag-") as made:
        folder = Path(made)
        if described is None:
            yield _unpack(path, folder, shutil.disk_usage(folder).free // 2)
            return
        left = shutil.disk_usage(folder).free // 2
        names = []
        for name in described["relative_file_paths"]:
            unpacked = _unpack(path / Path(str(name)).name, folder, left)
            left -= unpacked.stat().st_size
            names.append(unpacked.name)
        plain = {**described, "relative_file_paths": names, "compression_mode": "", "compression_format": ""}
        _write_metadata(folder / _METADATA, plain)
        yield folder


def _described(folder: Path) -> dict[str, Any] | None:
    """Compression of a bag's files as ``metadata.yaml`` says it; None for another bag."""
    import yaml

    path = folder / _METADATA
    if not path.exists():
        raise MalformedData(
            f"no {_METADATA}: the recording was cut off. Open its .mcap or .db3 file itself, or run "
            "`ros2 bag reindex`"
        )
    try:
        described = yaml.safe_load(path.read_bytes())
        information = described.get(_INFORMATION, {}) if isinstance(described, Mapping) else None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MalformedData(f"{_METADATA}: {error}") from error
    if not isinstance(information, Mapping):
        raise MalformedData(f"{_METADATA}: no {_INFORMATION}")
    if str(information.get("compression_mode")).lower() != "file":
        return None
    if not isinstance(information.get("relative_file_paths"), list):
        raise MalformedData(f"{_METADATA}: no relative_file_paths")
    return dict(information)


def _write_metadata(path: Path, information: dict[str, Any]) -> None:
    import yaml

    path.write_text(yaml.safe_dump({_INFORMATION: information}))


def _unpack(source: Path, folder: Path, max_bytes: int) -> Path:
    """Unpack a file into a folder. Returns its path, without the ending of the compression."""
    if not source.is_file():
        raise MalformedData(f"the file {source.name} is missing")
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


def limit_chunks() -> None:
    """Put decompressors with limits in the tables of rosbags, whose own ones have none."""
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap as mcap

    mcap.DECOMPRESSORS.update(zstd=_mcap_zstd, lz4=_mcap_lz4)
    ros1.decompressors.update(bz2=_ros1_bz2, lz4=_ros1_lz4)


def _mcap_zstd(data: bytes, size: int) -> bytes:
    return unpack_zstd(data, _checked(size), MAX_CHUNK_BYTES)


def _mcap_lz4(data: bytes, size: int) -> bytes:
    return _unpacked("lz4", _lz4(), data, _checked(size))


def _ros1_bz2(data: bytes) -> bytes:
    return _unpacked("bz2", bz2.BZ2Decompressor(), data, MAX_CHUNK_BYTES)


def _ros1_lz4(data: bytes) -> bytes:
    return _unpacked("lz4", _lz4(), data, MAX_CHUNK_BYTES)


def _lz4() -> Any:
    import lz4.frame  # rosbags needs it too

    return lz4.frame.LZ4FrameDecompressor()


def _checked(size: int) -> int:
    if size > MAX_CHUNK_BYTES:
        raise TooLarge(f"a chunk has {size} bytes, the limit is {MAX_CHUNK_BYTES}")
    return size


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
