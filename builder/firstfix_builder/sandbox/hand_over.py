"""Takes files out of a folder whose owner is not trusted and may change it at any moment.

A link in that folder could lead the reader to one of its own files, such as its credentials. So no link is
followed, at any level. The files that were taken stand in a folder to which the owner has no access.
"""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from firstfix.errors import BuildFailed

MAX_FILES = 100_000
MAX_DEPTH = 8
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC


def take_files(root: Path, folder: str, into: Path) -> None:
    """Link the files below ``root/folder`` into a new folder, or copy them.

    Args:
        root: a folder that the owner cannot replace.
        folder: path below it, as given by the owner.

    Raises:
        BuildFailed: the path leads elsewhere, or something in the folder is not a regular file.
    """
    into.mkdir(parents=True)
    try:
        with _opened(root, folder) as handle:
            _take(handle, into, MAX_DEPTH, _Budget(MAX_FILES))
    except OSError as error:
        raise BuildFailed(f"the build's files cannot be taken over: {error.strerror}") from None


class _Budget:
    def __init__(self, left: int) -> None:
        self.left = left

    def spend(self) -> None:
        self.left -= 1
        if self.left < 0:
            raise BuildFailed(f"the build made more than {MAX_FILES} files")


@contextmanager
def _opened(root: Path, folder: str) -> Iterator[int]:
    parts = PurePosixPath(folder).parts
    if not parts or any(part in ("/", "..") for part in parts):
        raise BuildFailed("the build named a folder outside its own")
    handle = os.open(root, _FOLDER)
    try:
        for part in parts:
            inner = os.open(part, _FOLDER, dir_fd=handle)
            os.close(handle)
            handle = inner
        yield handle
    finally:
        os.close(handle)


def _take(folder: int, into: Path, depth: int, budget: _Budget) -> None:
    for name in os.listdir(folder):
        budget.spend()
        mode = os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode
        if stat.S_ISREG(mode):
            _take_file(folder, name, into / name)
        elif stat.S_ISDIR(mode) and depth:
            inner = os.open(name, _FOLDER, dir_fd=folder)
            try:
                (into / name).mkdir()
                _take(inner, into / name, depth - 1, budget)
            finally:
                os.close(inner)
        else:
            raise BuildFailed("the build made something that is not a regular file")


def _take_file(folder: int, name: str, target: Path) -> None:
    """Take a file, and check its type again afterwards: the owner may have replaced it meanwhile."""
    try:
        os.link(name, target, src_dir_fd=folder, follow_symlinks=False)
    except OSError:  # another file system, or one without links
        handle = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
        with os.fdopen(handle, "rb") as source:
            if not stat.S_ISREG(os.fstat(source.fileno()).st_mode):
                raise BuildFailed("the build made something that is not a regular file") from None
            with target.open("xb") as copy:
                shutil.copyfileobj(source, copy)
    if not stat.S_ISREG(target.lstat().st_mode):
        target.unlink()
        raise BuildFailed("the build made something that is not a regular file")
