"""Objects of a file store that survive a power cut whole.

A file gets its name only after its bytes are on disk. The bytes are written to a part file beside it and
synced. Then the part is linked to the name (a new object) or renamed to it (a replaced object), and the
folder is synced. In the opposite order the name could reach the disk half a minute before the bytes.
"""

from __future__ import annotations

import ctypes
import errno
import os
import re
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from ..errors import StoreUnsafe

_PART = re.compile(r".+#\d+")  # obstore does not list such names, and no key contains '#'
_NO_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS)  # errors of link on file systems without hard links
_MAX_FOLDERS = 10_000  # remembered as durable
_AT_FDCWD, _RENAME_NOREPLACE = -100, 1  # linux/fcntl.h, linux/fs.h


class DurableFiles:
    """Objects of a file store below one directory. Thread-safe; processes may share the directory.

    Args:
        is_cache: nothing waits for the disk, so a power cut may leave objects torn, or take them away.
    """

    def __init__(self, root: Path, *, is_cache: bool = False) -> None:
        self._root = root
        self._is_cache = is_cache
        self._durable_folders: dict[Path, int] = {}  # folder whose entry in its parent is on disk: inode

    def create(self, key: str, pieces: Iterable[bytes]) -> bool:
        """Write a new object. Returns False if the key exists: of many writers at once, one wins.

        Raises:
            StoreUnsafe: the file system can neither link nor rename without replacing.
            OSError: an error of the file system. Then there is no object, unless only the last sync failed.
        """
        path = self._root / key
        with self._part(path, pieces) as part:
            created = _name_new(part, path)
        self._sync(path.parent)  # for the loser too: its caller may continue as if the object were its own
        return created

    def replace(self, key: str, pieces: Iterable[bytes]) -> None:
        """Write an object in place of the one that may be there. Readers see the old or the new one.

        Raises:
            OSError: an error of the file system.
        """
        path = self._root / key
        with self._part(path, pieces) as part:
            part.replace(path)
        self._sync(path.parent)

    def sync_name(self, key: str) -> None:
        """Sync an object's name, which another writer may have just given. Its bytes are on disk already."""
        folder = (self._root / key).parent
        self._sync(folder)
        self._sync_entries_of(folder)

    def removed(self, key: str) -> None:
        """Make an object's removal durable, and remove the folders that it left empty except the uppermost.

        Without the sync a revoked API key could come back after a power cut.
        """
        folder = (self._root / key).parent
        with suppress(OSError):  # it is not empty, or another process removed it
            while self._root not in (folder, folder.parent):
                folder.rmdir()
                self._durable_folders.pop(folder, None)
                folder = folder.parent
        while folder != self._root and not folder.is_dir():
            folder = folder.parent
        self._sync(folder)

    def remove_parts(self, before: datetime, *, dry_run: bool = False) -> list[str]:
        """Remove what puts left that were killed before a time: hidden part files and empty folders.

        Returns:
            Names of the files.
        """
        removed = []
        for path in self._root.rglob("*#*"):
            with suppress(FileNotFoundError):
                if _PART.fullmatch(path.name) and path.stat().st_mtime <= before.timestamp():
                    if not dry_run:
                        path.unlink()
                    removed.append(path.relative_to(self._root).as_posix())
        if not dry_run:
            for folder in sorted(self._root.glob("*/**"), reverse=True):  # deeper ones first
                with suppress(OSError):  # it is not empty, or another process removed it
                    if folder.parent != self._root and folder.stat().st_mtime <= before.timestamp():
                        folder.rmdir()
        return removed

    @contextmanager
    def _part(self, path: Path, pieces: Iterable[bytes]) -> Iterator[Path]:
        """Write all bytes to a part file beside the path and sync it. The part is removed afterwards."""
        part, handle = _open_part(path)
        try:
            with os.fdopen(handle, "wb") as file:
                self._sync_entries_of(path.parent)  # no other process removes a folder with a part in it
                for piece in pieces:
                    file.write(piece)
                file.flush()
                if not self._is_cache:
                    os.fsync(file.fileno())
            yield part
        finally:
            part.unlink(missing_ok=True)

    def _sync(self, folder: Path) -> None:
        if not self._is_cache:
            _sync_folder(folder)

    def _sync_entries_of(self, folder: Path) -> None:
        """Sync the directory entries of the folders that lead to this one."""
        if self._is_cache:
            return
        if len(self._durable_folders) > _MAX_FOLDERS:
            self._durable_folders.clear()
        for at in (folder, *folder.parents):
            inode = at.stat().st_ino  # differs if the folder was removed and made again
            if at == at.parent or self._durable_folders.get(at) == inode:
                return
            with _root_may_be_hidden(at, self._root):
                _sync_folder(at.parent)
            self._durable_folders[at] = inode


@contextmanager
def _root_may_be_hidden(folder: Path, root: Path) -> Iterator[None]:
    """Ignore a PermissionError above the root: an operator may have made folders this process cannot read."""
    try:
        yield
    except PermissionError:
        if root.is_relative_to(folder):
            return
        raise


def _open_part(path: Path) -> tuple[Path, int]:
    """Open a new file beside the path for writing. Makes the folder if it is missing."""
    while True:
        part = path.with_name(f"{path.name}#{uuid.uuid4().int}")
        with suppress(FileNotFoundError):  # another process removed the empty folder
            _make_folder(path.parent)
            return part, os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)


def _make_folder(folder: Path) -> None:
    """Make a folder and those above it if they are missing.

    Raises:
        FileNotFoundError: another process removed one of them meanwhile.
        OSError: an error of the file system, or a file has the folder's name.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:  # mkdir checks again whether it is a folder: by then it may be gone
        if folder.is_dir():
            return
        if folder.exists():
            raise
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(folder)) from None


def _name_new(part: Path, path: Path) -> bool:
    """Give the part its name. Returns False if the name is taken."""
    try:
        os.link(part, path)
    except FileExistsError:
        return False
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        return _rename_new(part, path)
    return True


def _rename_new(part: Path, path: Path) -> bool:
    """Give the part its name on a file system without hard links. Returns False if the name is taken."""
    libc = ctypes.CDLL(None, use_errno=True)
    try:
        rename = libc.renameat2
    except AttributeError:
        rename = None
    if rename is not None:
        failed = rename(_AT_FDCWD, os.fsencode(part), _AT_FDCWD, os.fsencode(path), _RENAME_NOREPLACE)
        number = ctypes.get_errno() if failed else 0
        if number in (0, errno.EEXIST):
            return not number
        if number not in (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP):
            raise OSError(number, os.strerror(number), str(path))
    raise StoreUnsafe(
        "this file system has neither hard links nor a rename that does not replace: two writers could "
        "overwrite each other. Use another one"
    )


def _sync_folder(folder: Path) -> None:
    with suppress(FileNotFoundError):  # another process removed it with its content
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
