"""Writes of a store: one interface for a cloud's bucket and for a directory."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Protocol

from ..errors import OutOfSpace
from .backend import BucketWriter, translated
from .durable_files import DurableFiles

_READ_BYTES = 1 << 20
RECORDS_BYTES = 16 << 20  # stay free beside large objects: who finds the disk full must be able to say so


class Writer(Protocol):
    """Writes objects and removes them. Thread-safe."""

    def create(self, key: str, data: bytes | Path) -> bool:
        """Write a new object, atomically. Returns False if the key exists."""

    def replace(self, key: str, data: bytes | Path) -> None:
        """Write an object in place of the one that may be there."""

    def replace_from_pieces(self, key: str, pieces: Iterable[bytes]) -> None:
        """Write an object piece by piece. If a piece raises, the error passes on and nothing is written."""

    def make_durable(self, key: str) -> None:
        """Make sure that an object that another writer just wrote survives a power cut."""

    def check_room(self, size_bytes: int, what: str) -> None:
        """Check that there is room for so many bytes, as far as that can be known."""

    def delete(self, key: str) -> None:
        """Remove an object. A missing object is no error."""

    def remove_parts(self, before: datetime, *, dry_run: bool) -> list[str]:
        """Remove parts that killed puts left before a time. Returns their names."""


class DirectoryWriter:
    """Writer to a directory.

    Args:
        is_cache: its objects need not survive a power cut.
    """

    def __init__(self, bucket: BucketWriter, root: Path, *, is_cache: bool = False) -> None:
        self._bucket = bucket
        self._root = root
        self._files = DurableFiles(root, is_cache=is_cache)

    def create(self, key: str, data: bytes | Path) -> bool:
        """Link a new file to the name. Returns False if the key exists."""
        with self._translated(key, data), _pieces(data) as pieces:
            return self._files.create(key, pieces)

    def replace(self, key: str, data: bytes | Path) -> None:
        """Rename a new file to the name."""
        with self._translated(key, data), _pieces(data) as pieces:
            self._files.replace(key, pieces)

    def replace_from_pieces(self, key: str, pieces: Iterable[bytes]) -> None:
        """Rename a new file, written piece by piece, to the name."""
        with self._translated(key, None):
            self._files.replace(key, pieces)

    def make_durable(self, key: str) -> None:
        """Sync the folder that holds the name."""
        self._files.sync_name(key)

    def check_room(self, size_bytes: int, what: str) -> None:
        """Check that the disk has room for so many bytes, and some for records after them."""
        if size_bytes + RECORDS_BYTES > shutil.disk_usage(self._root).free:
            raise self._full(what, size_bytes)

    def delete(self, key: str) -> None:
        """Remove an object, and the folders that it leaves empty except the uppermost."""
        self._bucket.delete(key)
        with translated(key, writing=True):
            self._files.removed(key)

    def remove_parts(self, before: datetime, *, dry_run: bool) -> list[str]:
        """Remove parts that killed puts left before a time. Returns their names."""
        return self._files.remove_parts(before, dry_run=dry_run)

    @contextmanager
    def _translated(self, key: str, data: bytes | Path | None) -> Iterator[None]:
        """Translate errors of a put. A full disk is named with the bytes needed, if known, and those free."""
        with translated(key, writing=True):
            try:
                yield
            except OSError as error:
                if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                    raise
                size = data.stat().st_size if isinstance(data, Path) else None if data is None else len(data)
                raise self._full(key, size) from None

    def _full(self, what: str, size_bytes: int | None) -> OutOfSpace:
        needed = "has no room for" if size_bytes is None else f"needs {size_bytes} bytes for"
        free = shutil.disk_usage(self._root).free
        return OutOfSpace(f"the store's disk {needed} {what}: {free} bytes are free")


@contextmanager
def _pieces(data: bytes | Path) -> Iterator[Iterable[bytes]]:
    """Bytes as one piece, a file in small pieces."""
    if isinstance(data, bytes):
        yield (data,)
    else:
        with data.open("rb") as file:
            yield iter(lambda: file.read(_READ_BYTES), b"")
