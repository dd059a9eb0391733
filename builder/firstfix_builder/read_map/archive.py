"""A folder in one file: a zip archive, which an upload or a URL can bring."""

from __future__ import annotations

import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from firstfix.errors import MalformedData, TooLarge

SUFFIX = ".zip"
MAX_FILES = 20_000
MAX_BYTES = 32 << 30  # of all files together, unpacked
_PIECE = 1 << 20


def unpack(archive: Path, folder: Path) -> Path:
    """Writes an archive's files below a new folder.

    Returns:
        The folder of the map: where the archive holds nothing but one folder, that one.

    Raises:
        MalformedData: damaged, encrypted, or with a name or a link that leads out of the folder.
        TooLarge: over MAX_FILES or MAX_BYTES.
    """
    folder.mkdir(parents=True)
    left = MAX_BYTES
    try:
        with zipfile.ZipFile(archive) as opened:
            entries = [entry for entry in opened.infolist() if not entry.is_dir()]
            if len(entries) > MAX_FILES:
                raise TooLarge(f"{archive.name}: {len(entries)} files, the limit is {MAX_FILES}")
            for entry in entries:
                target = folder.joinpath(*_parts(archive, entry))
                target.parent.mkdir(parents=True, exist_ok=True)
                left = _write(opened, entry, target, left)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise MalformedData(f"{archive.name}: {' '.join(str(error).split())[:200]}") from None
    except FileExistsError:
        raise MalformedData(f"{archive.name}: a file and a folder have the same name") from None
    inside = list(folder.iterdir())
    if not inside:
        raise MalformedData(f"{archive.name}: there is no file in it")
    return inside[0] if len(inside) == 1 and inside[0].is_dir() else folder


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
    """Unpacks one file. Counts what comes, whatever the archive says; returns the bytes that are left."""
    if target.is_dir():
        raise FileExistsError(target)
    with opened.open(entry) as packed, target.open("xb") as file:
        while piece := packed.read(_PIECE):
            left -= len(piece)
            if left < 0:
                raise TooLarge(f"the archive has over {MAX_BYTES} bytes unpacked")
            file.write(piece)
    return left
