"""A folder in one file: a zip archive, which an upload or a URL can bring."""

from __future__ import annotations

import errno
import lzma
import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from firstfix.errors import FirstfixError, MalformedData, OutOfSpace, TooLarge, UnsupportedFormat

from .scan_folders import FOLDER as MAPPING_SCANS

SUFFIX = ".zip"
MAX_FILES = 20_000
MAX_BYTES = 32 << 30  # of all files together, unpacked
MAX_DIRECTORY_BYTES = 16 << 20  # of the list of files: zipfile makes an object of every 46 bytes
_PIECE = 1 << 20
_END, _END_64 = b"PK\5\6", b"PK\6\6"  # of the list of files
_END_BYTES, _END_64_BYTES, _LOCATOR_BYTES = 22, 56, 20
_MAX_COMMENT = 65_535
_SYSTEM_FILES = (".DS_Store", "Thumbs.db", "desktop.ini")
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# Others reserve the memory that the archive asks for.
_PACKED_BY = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2)


def unpack(archive: Path, folder: Path) -> Path:
    """Write an archive's files below a new folder.

    Returns:
        The folder of the map: where the archive holds nothing but one folder, that one, unless it is that of
        mapping scans, which belongs to the map's folder.

    Raises:
        MalformedData: damaged, encrypted, or with a name or a link that leads out of the folder.
        TooLarge: over MAX_FILES, MAX_BYTES or MAX_DIRECTORY_BYTES.
        UnsupportedFormat: a file is packed by another method than deflate or bzip2.
        OutOfSpace: the unpacked files do not fit on the disk.
    """
    folder.mkdir(parents=True)
    left = MAX_BYTES
    with _damage_named(archive):
        _check_directory(archive)
        with zipfile.ZipFile(archive) as opened:
            entries = [entry for entry in opened.infolist() if _counts(entry)]
            _check(archive, entries, folder)
            for entry in entries:
                target = folder.joinpath(*_parts(archive, entry))
                target.parent.mkdir(parents=True, exist_ok=True)
                left = _write(opened, entry, target, left)
    inside = list(folder.iterdir())
    if not inside:
        raise MalformedData(f"{archive.name}: there is no file in it")
    is_wrapped = len(inside) == 1 and inside[0].is_dir() and inside[0].name != MAPPING_SCANS
    return inside[0] if is_wrapped else folder


def _counts(entry: zipfile.ZipInfo) -> bool:
    """Whether an entry is a file, and none that macOS and Windows add of themselves."""
    name = entry.filename.rsplit("/", 1)[-1]
    return bool(name) and name not in _SYSTEM_FILES and not name.startswith("._")


@contextmanager
def _damage_named(archive: Path) -> Iterator[None]:
    """Turn what zipfile raises about a damaged archive into MalformedData."""
    try:
        yield
    except FirstfixError:
        raise
    except FileExistsError:
        raise MalformedData(f"{archive.name}: a file and a folder have the same name") from None
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise OutOfSpace(f"{archive.name}: the work disk is full") from None
        raise MalformedData(f"{archive.name}: {error.strerror or error}") from None
    except (
        *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError),
        *(IndexError, ValueError, OverflowError, struct.error),  # ValueError: of Unicode too
    ) as error:
        raise MalformedData(
            f"{archive.name}: {' '.join(str(error).split())[:200] or type(error).__name__}"
        ) from None


def _check_directory(archive: Path) -> None:
    """Check the size of the list of files, before an object is made of each."""
    size = archive.stat().st_size
    with archive.open("rb") as file:
        file.seek(max(0, size - _END_BYTES - _MAX_COMMENT - _LOCATOR_BYTES - _END_64_BYTES))
        tail = file.read()
    at = tail.rfind(_END)
    if at < 0 or len(tail) - at < _END_BYTES:
        raise MalformedData(f"{archive.name}: it is no zip archive, or cut off")
    (declared,) = struct.unpack_from("<I", tail, at + 12)
    large = tail.rfind(_END_64, 0, at)
    if declared == 0xFFFFFFFF and large >= 0:
        (declared,) = struct.unpack_from("<Q", tail, large + 40)
    if declared > size:
        raise MalformedData(f"{archive.name}: a list of files of {declared} bytes in {size}")
    if declared > MAX_DIRECTORY_BYTES:
        raise TooLarge(
            f"{archive.name}: a list of files of {declared} bytes, the limit is {MAX_DIRECTORY_BYTES}"
        )


def _check(archive: Path, entries: list[zipfile.ZipInfo], folder: Path) -> None:
    """Check what the archive declares, before the first file is written."""
    if len(entries) > MAX_FILES:
        raise TooLarge(f"{archive.name}: {len(entries)} files, the limit is {MAX_FILES}")
    others = [entry for entry in entries if entry.compress_type not in _PACKED_BY]
    if others:
        raise UnsupportedFormat(
            f"{archive.name}: {others[0].filename[:100]!r} is packed by method {others[0].compress_type}"
        )
    declared, free = sum(entry.file_size for entry in entries), shutil.disk_usage(folder).free
    if declared > MAX_BYTES:
        raise TooLarge(f"{archive.name}: {declared} bytes unpacked, the limit is {MAX_BYTES}")
    if declared > free:
        raise OutOfSpace(f"{archive.name}: {declared} bytes unpacked, and the disk has {free} left")


def _parts(archive: Path, entry: zipfile.ZipInfo) -> tuple[str, ...]:
    """The entry's name, by its segments."""
    path = PurePosixPath(entry.filename)
    if path.is_absolute() or ".." in path.parts or "\\" in entry.filename or not path.parts:
        raise MalformedData(f"{archive.name}: {entry.filename[:100]!r} leads out of the folder")
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG):
        raise MalformedData(f"{archive.name}: {entry.filename[:100]!r} is not a regular file")
    return path.parts


def _write(opened: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path, left: int) -> int:
    """Unpack one file. Counts what comes, whatever the archive says; returns the bytes that are left."""
    if target.is_dir():
        raise FileExistsError(target)
    with opened.open(entry) as packed, target.open("xb") as file:
        while piece := packed.read(_PIECE):
            left -= len(piece)
            if left < 0:
                raise TooLarge(f"the archive has over {MAX_BYTES} bytes unpacked")
            file.write(piece)
    return left
