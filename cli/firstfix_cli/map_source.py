"""The source of a build: several sessions as one folder, a folder as the one file that a service takes."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from firstfix.errors import InvalidOption, NotFound

DESCRIPTION = "sessions.json"
_PIECE = 1 << 20


@dataclass(frozen=True)
class GivenSession:
    """A session as the command line names it.

    Attributes:
        source: map file or SLAM folder.
        trajectory: file of the mapping run's poses, or None.
    """

    source: Path
    trajectory: Path | None = None

    @classmethod
    def parse(cls, text: str) -> GivenSession:
        """``MAP`` or ``MAP,TRAJECTORY``.

        Raises:
            InvalidOption: more than one comma, or no map.
        """
        source, *rest = text.split(",")
        if not source or len(rest) > 1 or rest == [""]:
            raise InvalidOption(f"--merge takes MAP or MAP,TRAJECTORY, not {text!r}")
        return cls(Path(source), Path(rest[0]) if rest else None)


@contextmanager
def session_folder(sessions: Sequence[GivenSession]) -> Iterator[Path]:
    """A temporary folder with the sessions and the file that lists them. Files are linked where that works.

    Raises:
        NotFound: there is no such file.
    """
    with TemporaryDirectory(prefix="firstfix-sessions-") as made:
        folder, listed = Path(made), []
        for number, session in enumerate(sessions, start=1):
            entry = {"source": _put(session.source, folder, f"{number}")}
            if session.trajectory is not None:
                entry["trajectory"] = _put(session.trajectory, folder, f"{number}-trajectory")
            listed.append(entry)
        (folder / DESCRIPTION).write_text(json.dumps({"sessions": listed}, indent=1) + "\n")
        yield folder


@contextmanager
def as_one_file(source: Path) -> Iterator[Path]:
    """The source, or a temporary zip archive of it if it is a folder. Equal folders make equal archives."""
    if not source.is_dir():
        yield source
        return
    with TemporaryDirectory(prefix="firstfix-archive-") as made:
        archive = Path(made) / f"{source.resolve().name}.zip"
        with zipfile.ZipFile(archive, "w") as opened:
            for path in sorted(path for path in source.rglob("*") if path.is_file()):
                name = path.relative_to(source).as_posix()
                if not any(part.startswith(".") for part in name.split("/")):
                    _pack(opened, path, name)
        yield archive


def _pack(archive: zipfile.ZipFile, path: Path, name: str) -> None:
    entry = zipfile.ZipInfo(name)  # without the file's date
    entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
    with path.open("rb") as file, archive.open(entry, "w", force_zip64=True) as packed:
        shutil.copyfileobj(file, packed, _PIECE)


def _put(source: Path, folder: Path, below: str) -> str:
    """The name of a file or folder below the new folder."""
    if not source.exists():
        raise NotFound(f"{source}: no such file")
    name = f"{below}/{source.resolve().name}"
    (folder / below).mkdir()
    if source.is_dir():
        shutil.copytree(source, folder / name, copy_function=_link)
    else:
        _link(str(source.resolve()), str(folder / name))
    return name


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:  # another file system
        shutil.copyfile(source, target)
