"""Process of one build: its start, its memory limit, its stop, and the reason of its end.

All queues run builds in such a process, because the service itself has no mesh tool.
"""

from __future__ import annotations

import asyncio
import os
import signal
import time
from asyncio.subprocess import Process
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from firstfix.errors import BuildError

from ..thread_pools import BUILDS
from .metrics import last_message
from .session_processes import kill_session, session_memory_bytes

STOP_GRACE_S = 10.0  # between SIGTERM and SIGKILL
OLD_LOG_S = 30 * 86400.0
_LOOK_S = 1.0
_SECRET_PREFIXES = ("FIRSTFIX_NATS_",)  # a process that reads files of strangers must not have them


@dataclass(frozen=True)
class BuildCommand:
    """Command and limits of build processes.

    Attributes:
        command: runs one build. These options are appended: --store, --build, --work, --tied-to-stdin and,
            with ``share_stages``, --share-stages.
        niceness: of the process; a higher value leaves more processor time to queries.
        max_memory_bytes: limit of the process and all that it starts; None: no limit.
        environment: variables added to those of this process.
    """

    command: tuple[str, ...]
    store_url: str
    niceness: int
    share_stages: bool
    max_memory_bytes: int | None
    environment: Mapping[str, str] = field(default_factory=dict)


class BuildProcess:
    """A running build process.

    Its standard input stays open as long as this process lives. If this process is killed, the build process
    ends too and does not run beside its successor.
    """

    def __init__(self, process: Process, log_path: Path, max_memory_bytes: int | None) -> None:
        self._process = process
        self._log_path = log_path
        self._max_memory_bytes = max_memory_bytes
        self.exceeded_memory = False  # it was killed for its memory
        self.overdue: BuildError | None = None  # it was killed for its time, with this error

    @classmethod
    async def start(cls, how: BuildCommand, build_id: str, work_dir: Path) -> BuildProcess:
        """Starts the process.

        Raises:
            OSError: the command cannot be run.
        """
        log_path = work_dir / f"{build_id}.log"
        arguments = ("--store", how.store_url, "--build", build_id, "--work", str(work_dir))
        options = ("--tied-to-stdin", *(["--share-stages"] if how.share_stages else []))
        inherited = {k: v for k, v in os.environ.items() if not k.startswith(_SECRET_PREFIXES)}
        with await BUILDS.run(_open_log, log_path) as log:
            process = await asyncio.create_subprocess_exec(
                *how.command,
                *arguments,
                *options,
                stdin=asyncio.subprocess.PIPE,
                stdout=log,
                stderr=log,
                env={**inherited, **how.environment},
                start_new_session=True,  # Ctrl-C goes to the service only, which then stops the build
            )
        with suppress(OSError):  # it has ended already
            os.setpriority(os.PRIO_PROCESS, process.pid, how.niceness)
        return cls(process, log_path, how.max_memory_bytes)

    async def wait(self, timeout_s: float) -> int | None:
        """Returns the exit code; None if the process still runs after that time."""
        end = time.monotonic() + timeout_s
        while True:
            with suppress(TimeoutError):
                # wait_for can lose a cancellation at the end of the process (gh-86296)
                async with asyncio.timeout(max(min(_LOOK_S, end - time.monotonic()), 0.0)):
                    return await self._process.wait()
            if self._max_memory_bytes is not None and not self.exceeded_memory:
                used = await BUILDS.run(session_memory_bytes, self._process.pid)
                if used > self._max_memory_bytes:
                    self.exceeded_memory = True
                    self.kill()
            if time.monotonic() >= end:
                return None

    async def stop(self) -> int:
        """Asks the process to end, kills it after ``STOP_GRACE_S``, and returns its exit code."""
        with suppress(ProcessLookupError, PermissionError):  # the leader of a group; its sandbox ends with it
            os.killpg(self._process.pid, signal.SIGTERM)
        with suppress(TimeoutError):
            async with asyncio.timeout(STOP_GRACE_S):
                await self._process.wait()
        self.kill()  # with all that it left behind
        return await self._process.wait()

    def kill(self) -> None:
        """Kills the process and all that it started.

        It reads /proc, which takes milliseconds. In a thread pool it could wait for a store that hangs.
        """
        kill_session(self._process.pid)

    def why(self, code: int) -> str:
        """Returns a message about the end of a process that recorded no reason itself."""
        if self.exceeded_memory:
            return (
                f"the build took more memory than the limit of {self._max_memory_bytes} bytes "
                "(FIRSTFIX_BUILD_MAX_MEMORY_BYTES)"
            )
        if code < 0:
            hint = " (out of memory?)" if code == -signal.SIGKILL else ""
            return f"the build process was killed by {signal.Signals(-code).name}{hint}"
        message = last_message(self._log_path)
        return f"the build process failed with exit code {code}" + (f": {message}" if message else "")

    def remove_log(self) -> None:
        """Removes the log file."""
        self._log_path.unlink(missing_ok=True)


def _open_log(path: Path) -> BinaryIO:
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_old_logs(path.parent)
    return path.open("ab")


def _remove_old_logs(work_dir: Path) -> None:
    """Removes logs of failed builds after ``OLD_LOG_S``."""
    for path in work_dir.glob("*.log"):
        with suppress(FileNotFoundError):
            if time.time() - path.stat().st_mtime > OLD_LOG_S:
                path.unlink()
