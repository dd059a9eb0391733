"""Processes of the drill, each with its children: started, stopped by SIGSTOP, killed and measured."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def tree_of(pid: int) -> list[int]:
    """The process and its descendants that live."""
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):  # ended meanwhile
            # After the name, which may hold anything: state, parent.
            state, parent = (folder / "stat").read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                children.setdefault(int(parent), []).append(int(folder.name))
    found, at = [pid], 0
    while at < len(found):
        found += children.get(found[at], [])
        at += 1
    return found


def resident_bytes(pids: Sequence[int]) -> int:
    """Memory of these processes together, as far as they live."""
    total = 0
    for pid in pids:
        with suppress(OSError, IndexError):
            total += int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_BYTES
    return total


def marked_with(variable: str, value: str) -> list[int]:
    """Process that have this variable in their environment, which children inherit."""
    wanted, found = f"{variable}={value}".encode(), []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if wanted in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
    return found


def command_of(pid: int) -> str:
    """The command line of a process; empty if it has ended."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    return ""


def send(pids: Sequence[int], number: signal.Signals) -> None:
    """Send a signal to each of them that lives."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, number)


class Member:
    """One process of the deployment, started again after it was killed.

    Args:
        environment: variables beside those of this process.
        folder: in which it runs.
    """

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], log: Path, folder: Path | None = None
    ) -> None:
        self._command = list(command)
        self._environment = {**os.environ, **environment}
        self._folder = folder
        self.log = log
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    @property
    def has_ended(self) -> bool:
        """True if it ended by itself, or was killed by somebody else."""
        return self._process is not None and self._process.poll() is not None

    def start(self) -> None:
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                self._command,
                env=self._environment,
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def freeze(self) -> None:
        send(tree_of(self.pid), signal.SIGSTOP)

    def thaw(self) -> None:
        send(tree_of(self.pid), signal.SIGCONT)

    def kill(self) -> None:
        """End it and its children at once."""
        if self._process is not None:
            send(tree_of(self.pid), signal.SIGKILL)
            self._process.wait()
            self._process = None
