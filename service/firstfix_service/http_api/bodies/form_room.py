"""Disk space for a form's files: in the work folder, where they arrive, and for the copy in the store."""

from __future__ import annotations

import shutil
import uuid
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from firstfix.store.store import Store

from ...thread_pools import COPIES
from .disk_space import DiskSpace, Reservation


class FormRoom:
    """Disk space of one form.

    Attributes:
        directory: for the files; it is removed with them.
    """

    def __init__(self, directory: Path, here: Reservation, in_store: Reservation) -> None:
        self.directory = directory
        self._here = here
        self._in_store = in_store

    def take(self, size_bytes: int) -> None:
        """Announces a write of so many bytes to the directory.

        Raises:
            OutOfSpace: there is no room here or in the store.
        """
        self._here.take(size_bytes)
        self._in_store.ensure(self._here.taken_bytes)


@asynccontextmanager
async def form_room(
    disks: DiskSpace, store: Store, folder: Path, declared_bytes: int
) -> AsyncIterator[FormRoom]:
    """Makes a directory for one form and reserves space for it, until the block ends.

    Args:
        folder: parent of the directory.
        declared_bytes: size of the form; 0: not declared.

    Raises:
        OutOfSpace: there is no room for the declared size. No directory was made.
    """
    directory = folder / uuid.uuid4().hex
    with (
        disks.reserve("this service's disk", folder) as here,
        disks.reserve("the store's disk", store.directory) as in_store,
    ):

        def make() -> None:
            folder.mkdir(parents=True, exist_ok=True)
            here.ensure(declared_bytes)
            in_store.ensure(declared_bytes)
            directory.mkdir()

        try:
            await COPIES.run(make)
            yield FormRoom(directory, here, in_store)
        finally:
            await COPIES.run(shutil.rmtree, directory, ignore_errors=True)
