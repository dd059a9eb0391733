"""One build in a process of its own: started, watched, stopped, and what is known of its end.

Whichever queue runs a build runs it here. The service has no mesh tool: the command has.
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

from firstfix.errors import BuildError

from ..lanes import BUILDS
from .metrics import last_words
from .session_processes import kill_session, session_memory_bytes

EXIT_TRY_AGAIN = 75  # EX_TEMPFAIL: stopped, or the store is out of reach
STOP_GRACE_S = 10.0  # from asking a process to end until it is ended
OLD_LOG_S = 30 * 86400.0
_LOOK_S = 1.0
_SECRET_PREFIXES = ("FIRSTFIX_NATS_",)  # a process that reads strangers' files has no need of them


@dataclass(frozen=True)
class BuildCommand:
    """How builds are run here.

    Attributes:
        command: runs one build; --store, --build, --work, --tied-to-stdin and, with ``share_stages``,
            --share-stages are appended.
        niceness: how far they stand back behind queries.
        max_memory_bytes: of the process and all that it starts; None: no limit.
        environment: set for it beside what this process has.
    """

    command: tuple[str, ...]
    store_url: str
    niceness: int
    share_stages: bool
    max_memory_bytes: int | None
    environment: Mapping[str, str] = field(default_factory=dict)


class BuildProcess:
    """A started build. Its standard input stays open as long as this process lives: when that is killed,
    the build ends too, rather than go on beside its successor."""

    def __init__(self, process: Process, log_path: Path, max_memory_bytes: int | None) -> None:
        self._process = process
        self._log_path = log_path
        self._max_memory_bytes = max_memory_bytes
        self.took_too_much = False  # it was ended for its memory
        self.overdue: BuildError | None = None  # it was ended for its time, and this is why

    @classmethod
    async def start(cls, how: BuildCommand, build_id: str, work_dir: Path) -> BuildProcess:
        """
        Raises:
            OSError: the command cannot be run.
        """
        work_dir.mkdir(parents=True, exist_ok=True)
        _remove_old_logs(work_dir)
        log_path = work_dir / f"{build_id}.log"
        arguments = ("--store", how.store_url, "--build", build_id, "--work", str(work_dir))
        options = ("--tied-to-stdin", *(["--share-stages"] if how.share_stages else []))
        inherited = {k: v for k, v in os.environ.items() if not k.startswith(_SECRET_PREFIXES)}
        with log_path.open("ab") as log:
            process = await asyncio.create_subprocess_exec(
                *how.command,
                *arguments,
                *options,
                stdin=asyncio.subprocess.PIPE,
                stdout=log,
                stderr=log,
                env={**inherited, **how.environment},
                start_new_session=True,  # Ctrl-C is the service's, which then ends it in good order
            )
        with suppress(OSError):  # gone already
            os.setpriority(os.PRIO_PROCESS, process.pid, how.niceness)
        return cls(process, log_path, how.max_memory_bytes)

    async def wait(self, timeout_s: float) -> int | None:
        """The exit code; None when it still runs after that time."""
        end = time.monotonic() + timeout_s
        while True:
            with suppress(TimeoutError):
                # wait_for would lose a cancellation that comes as the process ends (gh-86296)
                async with asyncio.timeout(max(min(_LOOK_S, end - time.monotonic()), 0.0)):
                    return await self._process.wait()
            if self._max_memory_bytes is not None and not self.took_too_much:
                used = await BUILDS.run(session_memory_bytes, self._process.pid)
                if used > self._max_memory_bytes:
                    self.took_too_much = True
                    self.kill()
            if time.monotonic() >= end:
                return None

    async def stop(self) -> int:
        """Asks it to end in good order, and ends it when it does not. Its exit code."""
        with suppress(ProcessLookupError, PermissionError):  # it leads a group; its sandbox ends with it
            os.killpg(self._process.pid, signal.SIGTERM)
        with suppress(TimeoutError):
            async with asyncio.timeout(STOP_GRACE_S):
                await self._process.wait()
        self.kill()  # whatever it left behind as well
        return await self._process.wait()

    def kill(self) -> None:
        """With all that it started."""
        kill_session(self._process.pid)

    def why(self, code: int) -> str:
        """For people: how a process ended that did not say it in its status."""
        if self.took_too_much:
            return f"the build took more than the {self._max_memory_bytes} bytes of memory that it may"
        if code < 0:
            hint = " (out of memory?)" if code == -signal.SIGKILL else ""
            return f"the build process was ended by {signal.Signals(-code).name}{hint}"
        words = last_words(self._log_path)
        return f"the build process failed with exit code {code}" + (f": {words}" if words else "")

    def remove_log(self) -> None:
        self._log_path.unlink(missing_ok=True)


def _remove_old_logs(work_dir: Path) -> None:
    """Those of builds that failed stay for a while."""
    for path in work_dir.glob("*.log"):
        with suppress(FileNotFoundError):
            if time.time() - path.stat().st_mtime > OLD_LOG_S:
                path.unlink()
