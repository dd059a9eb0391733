"""The folder that one queue's builds work in: one process has it at a time, under a name that stays."""

from __future__ import annotations

import asyncio
import fcntl
import os
import uuid
from contextlib import suppress
from pathlib import Path

import structlog

from ..lanes import START

_log = structlog.get_logger(__name__)
WAIT_S = 1.0


class WorkFolder:
    """A folder with a lock that dies with its holder. On a disk of this machine: what is locked over the
    network may not be.

    Attributes:
        holder: the folder's name for ``BuildAttempts``: the same in every process that holds the
            folder, so that it knows its killed predecessor's attempts for dead.
    """

    def __init__(self, path: Path, handle: int, holder: str) -> None:
        self.path = path
        self._handle = handle
        self.holder = holder

    @classmethod
    def take(cls, path: Path) -> WorkFolder | None:
        """None while another process has it."""
        path.mkdir(parents=True, exist_ok=True)
        handle = os.open(path / "queue.lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            return None
        holder = uuid.uuid4().hex
        with suppress(FileNotFoundError):
            holder = (path / "queue.id").read_text().strip() or holder
        part = path / ".queue.id.part"
        part.write_text(holder)
        part.replace(path / "queue.id")
        return cls(path, handle, holder)

    @classmethod
    async def wait_for(cls, path: Path) -> WorkFolder:
        """At a deployment the next process may be there before the last one is gone."""
        waits = False
        while (folder := await START.run(cls.take, path)) is None:
            if not waits:
                _log.info("another process runs builds in this folder", work_dir=str(path))
            waits = True
            await asyncio.sleep(WAIT_S)
        return folder

    def release(self) -> None:
        os.close(self._handle)
