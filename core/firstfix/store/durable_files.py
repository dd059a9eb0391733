"""Objects of a file store that are still there, and whole, after a power cut.

A file gets its name only when its bytes are on disk: they are written to a part beside it and synced, the
part is linked to the name (a new object) or renamed to it (an object that is replaced), and then the folder
is synced. The other way round the name can reach the disk half a minute before the bytes.
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

_PART = re.compile(r".+#\d+")  # obstore lists no file of such a name; no key has a '#'
_NO_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS)  # what link says where there are no hard links
_MAX_FOLDERS = 10_000  # that are remembered
_AT_FDCWD, _RENAME_NOREPLACE = -100, 1  # linux/fcntl.h, linux/fs.h


class DurableFiles:
    """The objects of a file store, below one directory. Thread-safe; processes may share the directory."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._durable_folders: dict[Path, int] = {}  # whose entry in their parent is on disk: their inode

    def create(self, key: str, pieces: Iterable[bytes]) -> bool:
        """Writes a new object. False when there is one: of many writers at once one wins.

        Raises:
            StoreUnsafe: the file system can neither link nor rename without replacing.
            OSError: as the file system; there is no object then, unless only the last sync failed.
        """
        path = self._root / key
        with self._part(path, pieces) as part:
            created = _name_new(part, path)
        _sync_folder(path.parent)  # also for the loser: the caller may go on as if the object were its own
        return created

    def replace(self, key: str, pieces: Iterable[bytes]) -> None:
        """Writes an object in place of the one that may be there: readers see the old or the new one.

        Raises:
            OSError: as the file system.
        """
        path = self._root / key
        with self._part(path, pieces) as part:
            part.replace(path)
        _sync_folder(path.parent)

    def sync_name(self, key: str) -> None:
        """Brings an object's name to disk, which another writer may have given it just now. Its bytes are."""
        folder = (self._root / key).parent
        _sync_folder(folder)
        self._sync_entries_of(folder)

    def removed(self, key: str) -> None:
        """After an object's removal: removes the folders that it left empty, but the uppermost (other
        stores have none), and brings the removal to disk: a revoked key must not come back."""
        folder = (self._root / key).parent
        with suppress(OSError):  # it is not empty, or somebody removed it
            while self._root not in (folder, folder.parent):
                folder.rmdir()
                self._durable_folders.pop(folder, None)
                folder = folder.parent
        while folder != self._root and not folder.is_dir():
            folder = folder.parent
        _sync_folder(folder)

    def remove_parts(self, before: datetime, *, dry_run: bool = False) -> list[str]:
        """Removes what puts left that were killed before that time: files that no listing shows, and folders
        without a file, which one does show.

        Returns:
            the names of the files.
        """
        removed = []
        for path in self._root.rglob("*#*"):
            with suppress(FileNotFoundError):
                if _PART.fullmatch(path.name) and path.stat().st_mtime <= before.timestamp():
                    if not dry_run:
                        path.unlink()
                    removed.append(path.relative_to(self._root).as_posix())
        if not dry_run:
            for folder in sorted(self._root.glob("*/**"), reverse=True):  # the deeper ones first
                with suppress(OSError):  # it is not empty, or somebody removed it
                    if folder.parent != self._root and folder.stat().st_mtime <= before.timestamp():
                        folder.rmdir()
        return removed

    @contextmanager
    def _part(self, path: Path, pieces: Iterable[bytes]) -> Iterator[Path]:
        """A file beside the path with all the bytes, on disk; it is gone afterwards."""
        part, handle = _open_part(path)
        try:
            with os.fdopen(handle, "wb") as file:
                self._sync_entries_of(path.parent)  # with the part in it no other process removes it
                for piece in pieces:
                    file.write(piece)
                file.flush()
                os.fsync(file.fileno())
            yield part
        finally:
            part.unlink(missing_ok=True)

    def _sync_entries_of(self, folder: Path) -> None:
        """Brings the entries of the folders to disk that lead to this one."""
        if len(self._durable_folders) > _MAX_FOLDERS:
            self._durable_folders.clear()
        for at in (folder, *folder.parents):
            inode = at.stat().st_ino  # another one: somebody removed the folder and made it again
            if at == at.parent or self._durable_folders.get(at) == inode:
                return
            with _root_may_be_hidden(at, self._root):
                _sync_folder(at.parent)
            self._durable_folders[at] = inode


@contextmanager
def _root_may_be_hidden(folder: Path, root: Path) -> Iterator[None]:
    """A store's directory may stand in one that this process may not read: its operator made it."""
    try:
        yield
    except PermissionError:
        if root.is_relative_to(folder):
            return
        raise


def _open_part(path: Path) -> tuple[Path, int]:
    """A new file beside the path, open for writing. Its folder is made if it is missing."""
    while True:
        part = path.with_name(f"{path.name}#{uuid.uuid4().int}")
        with suppress(FileNotFoundError):  # somebody removed the folder, which was empty
            _make_folder(path.parent)
            return part, os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)


def _make_folder(folder: Path) -> None:
    """Makes a folder and those above it, where they are missing.

    Raises:
        FileNotFoundError: somebody removed one of them meanwhile.
        OSError: as the file system, also where a file stands in the way.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:  # mkdir looks again whether it is a folder: by then it may be gone
        if folder.is_dir():
            return
        if folder.exists():
            raise
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(folder)) from None


def _name_new(part: Path, path: Path) -> bool:
    """Gives the part the name; False when something has it already."""
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
    """As ``_name_new``, for file systems without hard links."""
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
    with suppress(FileNotFoundError):  # somebody removed it, with all that was in it
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
