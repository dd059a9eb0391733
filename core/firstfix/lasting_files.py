"""Files that are still there after a power cut: they are synced to disk, and so are their folders."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from datetime import datetime
from pathlib import Path

_PART = re.compile(r".+#\d+")  # obstore's own name for a file that is being written; no key has a '#'


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

    def remove_empty_folders(self, key: str) -> None:
        """Those that an object's removal left empty, but the uppermost: other stores have none."""
        folder = (self._root / key).parent
        with suppress(OSError):  # it is not empty, or somebody removed it
            while self._root not in (folder, folder.parent):
                folder.rmdir()
                self._lasting_folders.discard(folder)
                folder = folder.parent

    def remove_parts(self, before: datetime, *, dry_run: bool = False) -> list[str]:
        """Removes what puts left that were killed before that time: files that no listing shows."""
        removed = []
        for path in self._root.rglob("*#*"):
            with suppress(FileNotFoundError):
                if _PART.fullmatch(path.name) and path.stat().st_mtime <= before.timestamp():
                    if not dry_run:
                        path.unlink()
                    removed.append(path.relative_to(self._root).as_posix())
        return removed


def _sync(path: Path) -> None:
    with suppress(FileNotFoundError):  # somebody removed it since
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
