"""The processes of a session, read from /proc.

A build process leads a session, and its sandbox is a process group of that session.

Memory here means memory that the kernel cannot drop when it runs short. RLIMIT_AS does not fit, because it
limits one process, and a build reserves several times the memory that it uses (a small one has 1.6 GB of
addresses and 0.4 GB of memory). cgroups do not fit either, because few containers let a process make one.
"""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_PRIVATE = re.compile(rb"^(?:RssAnon|RssShmem):\s+(\d+) kB$", re.M)


def session_memory_bytes(session: int) -> int:
    """Returns the anonymous and shared memory of all processes of the session, without mapped files."""
    total = 0
    for folder, _ in _processes(session):
        with suppress(OSError):  # it has ended
            total += sum(int(kib) << 10 for kib in _PRIVATE.findall((folder / "status").read_bytes()))
    return total


def kill_session(session: int) -> None:
    """Kills all processes of the session, group by group: a group is killed at once, even while it forks."""
    for group in {session, *(group for _, group in _processes(session))}:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)


def _processes(session: int) -> Iterator[tuple[Path, int]]:
    """Yields the folder in /proc and the process group of each process."""
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            # The fields after the name, which can contain any character: state, parent, group, session.
            fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[3]) == session:
                yield folder, int(fields[2])
        except (OSError, IndexError, ValueError):  # it has ended
            continue
