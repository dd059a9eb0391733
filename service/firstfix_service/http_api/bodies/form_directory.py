"""Directory of a form's files, and the disk space for them: here, where they arrive, and in the store."""

from __future__ import annotations

import shutil
import uuid
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from ...thread_pools import COPIES
from ..parts import UploadParts
from .disk_space import Reservation


@dataclass(frozen=True)
class FormDirectory:
    """Directory of one form. It is removed with its files."""

    path: Path
    here: Reservation
    in_store: Reservation

    def take(self, size_bytes: int) -> None:
        """Announces a write of so many bytes to the directory.

        Raises:
            OutOfSpace: there is no room here or in the store.
        """
        self.here.take(size_bytes)
        self.in_store.ensure(self.here.taken_bytes)


@asynccontextmanager
async def form_directory(parts: UploadParts, declared_bytes: int) -> AsyncIterator[FormDirectory]:
    """Makes a directory for one form and reserves space for it, until the block ends.

    Args:
        declared_bytes: size of the form; 0: not declared.

    Raises:
        OutOfSpace: there is no room for the declared size. No directory was made.
    """
    path = parts.folder / uuid.uuid4().hex
    with (
        parts.disks.reserve("this service's disk", parts.folder) as here,
        parts.disks.reserve("the store's disk", parts.store.directory) as in_store,
    ):

        def make() -> None:
            parts.folder.mkdir(parents=True, exist_ok=True)
            here.ensure(declared_bytes)
            in_store.ensure(declared_bytes)
            path.mkdir()

        try:
            await COPIES.run(make)
            yield FormDirectory(path, here, in_store)
        finally:
            await COPIES.run(shutil.rmtree, path, ignore_errors=True)
