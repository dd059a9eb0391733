"""Files that are still there after a power cut: they are synced to disk, and so are their folders."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


class LastingFiles:
    """The objects of a file store, below one directory. Thread-safe."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._lasting_folders: set[Path] = set()  # their own entry in their parent is on disk

    def sync(self, key: str) -> None:
        """Brings an object to disk, and the entries of the folders that lead to it."""
        path = self._root / key
        _sync(path)
        _sync(path.parent)
        folder = path.parent
        while folder != self._root and folder not in self._lasting_folders:
            _sync(folder.parent)
            self._lasting_folders.add(folder)
            folder = folder.parent


def _sync(path: Path) -> None:
    with suppress(FileNotFoundError):  # somebody removed it since
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
