"""The processes of a session, as /proc tells of them: a build's, which leads one. Within it
the build's sandbox is a process group of its own.

Memory is what the kernel cannot drop when it runs short. Not by RLIMIT_AS: it is of one process, and a build
reserves several times what it touches (a small one has 1.6 GB of addresses and 0.4 GB of memory). Not by
cgroups: few containers let a process make its own.
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
    """Anonymous and shared memory of all processes of the session; mapped files do not count."""
    total = 0
    for folder, _ in _processes(session):
        with suppress(OSError):  # ended meanwhile
            total += sum(int(kib) << 10 for kib in _PRIVATE.findall((folder / "status").read_bytes()))
    return total


def kill_session(session: int) -> None:
    """All processes of it, group by group: a group is killed at one moment, also while it grows."""
    for group in {session, *(group for _, group in _processes(session))}:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)


def _processes(session: int) -> Iterator[tuple[Path, int]]:
    """Folder in /proc, and group."""
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            # After the name, which may hold anything: state, parent, group, session.
            fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[3]) == session:
                yield folder, int(fields[2])
        except (OSError, IndexError, ValueError):  # ended meanwhile
            continue
