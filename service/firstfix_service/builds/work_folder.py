"""Work folder of builds: one process at a time runs builds in it, and tells the others who it is."""

from __future__ import annotations

import asyncio
import fcntl
import json
import os
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import structlog

from firstfix.store.url import StoreUrl

from ..settings import Settings
from ..thread_pools import START

_log = structlog.get_logger(__name__)
WAIT_S = 1.0  # for a folder that another process has


@dataclass(frozen=True)
class Holder:
    """Process that has a work folder.

    Attributes:
        pid: 0: it has not said.
        store: identity of the store whose builds it runs; empty: it has not said.
    """

    pid: int = 0
    store: str = ""

    @classmethod
    def read(cls, lock: Path) -> Holder:
        """Read what the process that has the lock has written into it."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            said = json.loads(lock.read_bytes())
            return cls(int(said["pid"]), str(said["store"]))
        return cls()

    def why_others_wait(self, store: str) -> str | None:
        """Why builds of a store do not begin; None: this process runs them."""
        if self.store == store:
            return None
        whose = "builds of another store" if self.store else "builds"
        return (
            f"another process runs {whose} in the work folder of this service: give this service a folder of "
            "its own (FIRSTFIX_WORK_DIR, or --work)"
        )


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
    def take(cls, path: Path, store: str = "") -> WorkFolder | Holder:
        """Take the folder; returns the process that has it, if another one has.

        Args:
            store: identity of the store whose builds this process runs.
        """
        path.mkdir(parents=True, exist_ok=True)
        lock = path / "queue.lock"
        handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            return Holder.read(lock)
        try:
            os.ftruncate(handle, 0)
            os.pwrite(handle, json.dumps({"pid": os.getpid(), "store": store}).encode(), 0)
            claimant = uuid.uuid4().hex
            with suppress(FileNotFoundError):
                claimant = (path / "queue.id").read_text().strip() or claimant
            part = path / ".queue.id.part"
            part.write_text(claimant)
            part.replace(path / "queue.id")
        except OSError:  # a full disk
            os.close(handle)
            raise
        return cls(path, handle, claimant)

    @classmethod
    async def wait_for(
        cls, path: Path, settings: Settings, tell: Callable[[str | None], None] = lambda why: None
    ) -> WorkFolder:
        """Take the folder as soon as it is free. During a deployment the old process may still have it.

        Args:
            tell: called with the reason why builds wait, whenever it is looked for; None: they do not.
        """
        store = StoreUrl.parse(settings.store).identity()
        told: Holder | OSError | None = None
        looks = 0
        while not isinstance(found := await START.run(_taken, path, store), WorkFolder):
            looks += 1
            # Who has just taken it is about to say who it is.
            if looks > 1 or found != Holder():
                tell(_why(found, store))
                if repr(found) != repr(told):
                    _log_wait(found, store, path)
                told = found
            await asyncio.sleep(WAIT_S)
        tell(None)
        return found

    def release(self) -> None:
        """Give the folder back."""
        os.close(self._handle)


def _taken(path: Path, store: str) -> WorkFolder | Holder | OSError:
    try:
        return WorkFolder.take(path, store)
    except OSError as error:  # it may be mended while the service answers queries
        return error


def _why(found: Holder | OSError, store: str) -> str | None:
    if isinstance(found, OSError):
        return f"the work folder of this service cannot be used: {found.strerror}"
    return found.why_others_wait(store)


def _log_wait(found: Holder | OSError, store: str, path: Path) -> None:
    why, folder = _why(found, store), str(path)
    if isinstance(found, OSError):
        _log.warning("builds wait", why=why, work_dir=folder)
    elif why is None:
        _log.info("another process runs the builds of this store", work_dir=folder, pid=found.pid)
    else:
        who = {"pid": found.pid, "others_store": found.store} if found.pid else {}
        _log.warning("builds wait", why=why, work_dir=folder, **who)
