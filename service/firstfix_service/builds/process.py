"""Process of one build: its options and work folder, its start, its memory limit, and the reason of its end.

All queues run builds in such a process, because the service itself has no mesh tool. It leads a session, and
its sandbox is a process group of that session.

Memory here means memory that the kernel cannot drop when it runs short. RLIMIT_AS does not fit, because it
limits one process, and a build reserves several times the memory that it uses (a small one has 1.6 GB of
addresses and 0.4 GB of memory). cgroups do not fit either, because few containers let a process make one.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import time
from asyncio.subprocess import Process
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import structlog

from firstfix.builds.options import WHEN_TOLD, BuildOptions
from firstfix.builds.records import MAX_LOG_BYTES
from firstfix.errors import BuildError

from ..settings import Settings
from ..thread_pools import BUILDS

NICENESS = 10  # of build processes: queries come first
STOP_GRACE_S = 10.0  # between SIGTERM and SIGKILL
OLD_LOG_S = 30 * 86400.0
_LOOK_S = 1.0
_SECRET_PREFIXES = ("FIRSTFIX_NATS_",)  # a process that reads files of strangers must not have them
_PRIVATE = re.compile(rb"^(?:RssAnon|RssShmem):\s+(\d+) kB$", re.M)
_log = structlog.get_logger(__name__)


def build_options(settings: Settings) -> BuildOptions:
    """The options of every build. The process does not trust the record of the build."""
    return BuildOptions(
        store=settings.store,
        executor=settings.build_executor,
        sandbox=settings.build_sandbox,
        max_memory_bytes=settings.build_max_memory_bytes or None,
        max_templates=settings.build_max_templates or None,
        recorded_store=settings.recorded_store or "",
        source_urls=tuple(url for url in settings.source_urls if url.startswith(("http://", "https://"))),
        share_stages=settings.shared_stages_bytes > 0,
        tied_to_stdin=True,
        log_level=settings.log_level,
        log_json=settings.log_json,
    )


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
    async def start(cls, settings: Settings, options: BuildOptions) -> BuildProcess:
        """Start the build command of the settings, with the options of this build.

        Raises:
            OSError: the command cannot be run.
        """
        log_path = _log_path(options.work, options.build_id)
        inherited = {k: v for k, v in os.environ.items() if not k.startswith(_SECRET_PREFIXES)}
        with await BUILDS.run(_open_log, log_path) as log:
            process = await asyncio.create_subprocess_exec(
                *settings.build_command,
                *options.arguments(),
                stdin=asyncio.subprocess.PIPE,
                stdout=log,
                stderr=log,
                env=inherited | options.environment(),
                start_new_session=True,  # Ctrl-C goes to the service only, which then stops the build
            )
        with suppress(OSError):  # it has ended already
            os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
        return cls(process, log_path, options.max_memory_bytes)

    @property
    def is_running(self) -> bool:
        """Whether the process has not ended."""
        return self._process.returncode is None

    async def tell(self, build_id: str) -> bool:
        """Let a process that was started with ``WHEN_TOLD`` run a build.

        Returns False if it has ended, or if an earlier attempt of the build has left a log, which goes on.
        """
        log_path = _log_path(self._log_path.parent, build_id)
        if not self.is_running or not await BUILDS.run(_rename, self._log_path, log_path):
            return False
        self._log_path = log_path
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{build_id}\n".encode())
            await self._process.stdin.drain()
        except (BrokenPipeError, ConnectionResetError):
            return False
        return True

    async def wait(self, timeout_s: float) -> int | None:
        """The exit code; None if the process still runs after that time."""
        end = time.monotonic() + timeout_s
        while True:
            with suppress(TimeoutError):
                # wait_for can lose a cancellation at the end of the process (gh-86296)
                async with asyncio.timeout(max(min(_LOOK_S, end - time.monotonic()), 0.0)):
                    return await self._process.wait()
            if self._max_memory_bytes is not None and not self.exceeded_memory:
                used = await BUILDS.run(memory_of_processes_bytes, self._process.pid)
                if used > self._max_memory_bytes:
                    self.exceeded_memory = True
                    self.kill()
            if time.monotonic() >= end:
                return None

    async def stop(self) -> int:
        """Ask the process to end, kills it after ``STOP_GRACE_S``, and return its exit code."""
        with suppress(ProcessLookupError, PermissionError):  # the leader of a group; its sandbox ends with it
            os.killpg(self._process.pid, signal.SIGTERM)
        with suppress(TimeoutError):
            async with asyncio.timeout(STOP_GRACE_S):
                await self._process.wait()
        self.kill()  # with all that it left behind
        return await self._process.wait()

    def kill(self) -> None:
        """Kill the process and all that it started.

        It reads /proc, which takes milliseconds. In a thread pool it could wait for a store that hangs.
        """
        kill_processes(self._process.pid)

    def why(self, code: int) -> str:
        """A message about the end of a process that recorded no reason itself."""
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

    def end_of_log(self) -> str:
        """The last lines of the log file; empty if there is none."""
        try:
            with self._log_path.open("rb") as file:
                file.seek(max(0, self._log_path.stat().st_size - MAX_LOG_BYTES))
                return file.read(MAX_LOG_BYTES).decode(errors="replace")
        except OSError:
            return ""

    def remove_log(self) -> None:
        """Remove the log file."""
        self._log_path.unlink(missing_ok=True)


def last_message(log: Path) -> str | None:
    """The last line of a build's log, or its event if the line is JSON; None if there is no line."""
    try:
        line = log.read_text(errors="replace").strip().splitlines()[-1]
    except (OSError, IndexError):
        return None
    with suppress(ValueError, KeyError, TypeError):
        return str(json.loads(line)["event"])[:300]
    return line[:300]


def _log_path(work: Path, build_id: str) -> Path:
    return work / ("ready.log" if build_id == WHEN_TOLD else f"{build_id}.log")


def _rename(log: Path, new: Path) -> bool:
    """Rename a log, unless there is one with the new name, or none with the old one."""
    if new.exists() or not log.exists():
        return False
    log.rename(new)
    return True


def _open_log(path: Path) -> BinaryIO:
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_old_logs(path.parent)
    return path.open("ab")


def _remove_old_logs(work_dir: Path) -> None:
    """Remove logs of failed builds after ``OLD_LOG_S``."""
    for path in work_dir.glob("*.log"):
        with suppress(FileNotFoundError):
            if time.time() - path.stat().st_mtime > OLD_LOG_S:
                path.unlink()


def memory_of_processes_bytes(leader: int) -> int:
    """The anonymous and shared memory of the process and all it started, without mapped files."""
    total = 0
    for folder, _ in _processes(leader):
        with suppress(OSError):  # it has ended
            total += sum(int(kib) << 10 for kib in _PRIVATE.findall((folder / "status").read_bytes()))
    return total


def kill_processes(leader: int) -> None:
    """Kill the process and all that it started, by group: a group is killed at once, even while it forks."""
    for group in {leader, *(group for _, group in _processes(leader))}:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)


def _processes(leader: int) -> Iterator[tuple[Path, int]]:
    """Yield the folder in /proc and the process group of each process whose POSIX session this one leads."""
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            # The fields after the name, which can contain any character: state, parent, group, session.
            fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[3]) == leader:
                yield folder, int(fields[2])
        except (OSError, IndexError, ValueError):  # it has ended
            continue
