"""Locks on the cache of versions, which processes on this machine share. A lock dies with its process."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def exclusive_lock(path: Path, *, wait: bool = True) -> Iterator[None]:
    """Lock a file exclusively, and make it if it is missing. A kill leaves nothing to clean up.

    Raises:
        BlockingIOError: another process has the lock, and not ``wait``.
    """
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            if not _is_at(handle, path):  # removed while we waited: others lock a newer file
                continue
            yield
            return
        finally:
            os.close(handle)


class FolderLock:
    """Shared lock on a version's folder.

    No process removes the folder until the lock is closed or its process dies.
    """

    def __init__(self, path: Path) -> None:
        """Lock the folder.

        Raises:
            FileNotFoundError: the folder has just been removed: fetch the version again.
        """
        self.path = path
        self._handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
            if not _is_at(self._handle, path):
                raise FileNotFoundError(path)
        except OSError as error:
            os.close(self._handle)
            if isinstance(error, BlockingIOError):  # another process removes it
                raise FileNotFoundError(path) from None
            raise

    def close(self) -> None:
        """Unlock the folder."""
        os.close(self._handle)


def _is_at(handle: int, path: Path) -> bool:
    """Whether an open file is still the one at its path."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False
