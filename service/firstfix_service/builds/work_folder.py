"""Work folder of builds: one process uses it at a time, and it has a lasting id."""

from __future__ import annotations

import asyncio
import fcntl
import os
import uuid
from contextlib import suppress
from pathlib import Path

import structlog

from ..thread_pools import START

_log = structlog.get_logger(__name__)
WAIT_S = 1.0


class WorkFolder:
    """A folder with a lock that ends with its process.

    It must be on a local disk, because locks over a network are not reliable.

    Attributes:
        claimant: id of the folder, for ``BuildAttempts``. Every process that takes the folder has the same
            id, so it recognises open attempts of a killed predecessor.
    """

    def __init__(self, path: Path, handle: int, claimant: str) -> None:
        self.path = path
        self._handle = handle
        self.claimant = claimant

    @classmethod
    def take(cls, path: Path) -> WorkFolder | None:
        """Takes the folder; returns None if another process has it."""
        path.mkdir(parents=True, exist_ok=True)
        handle = os.open(path / "queue.lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            return None
        claimant = uuid.uuid4().hex
        with suppress(FileNotFoundError):
            claimant = (path / "queue.id").read_text().strip() or claimant
        part = path / ".queue.id.part"
        part.write_text(claimant)
        part.replace(path / "queue.id")
        return cls(path, handle, claimant)

    @classmethod
    async def wait_for(cls, path: Path) -> WorkFolder:
        """Takes the folder as soon as it is free. During a deployment the old process may still have it."""
        waits = False
        while (folder := await START.run(cls.take, path)) is None:
            if not waits:
                _log.info("another process runs builds in this folder", work_dir=str(path))
            waits = True
            await asyncio.sleep(WAIT_S)
        return folder

    def release(self) -> None:
        """Gives the folder back."""
        os.close(self._handle)
