"""Limits on the processes and threads of a process group.

RLIMIT_NPROC does not help: it counts all processes of a user on the machine, also those in other containers,
and does not apply to root.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

# A build has one process for each processor, and in each process a few threads for each processor.
MAX_PROCESSES = 64 + 4 * (os.cpu_count() or 1)
MAX_THREADS = 1024 + 16 * (os.cpu_count() or 1) ** 2


def too_many_processes(group: int) -> str:
    """Returns a message about the limit that the group exceeds; empty if it exceeds none."""
    processes = threads = 0
    for count in _threads(group):
        processes += 1
        threads += count
    if processes > MAX_PROCESSES:
        return f"the build started more than {MAX_PROCESSES} processes"
    if threads > MAX_THREADS:
        return f"the build started more than {MAX_THREADS} threads"
    return ""


def wait_until_ended(group: int, timeout_s: float) -> None:
    """Waits until no process of the group runs; all of them were killed."""
    end = time.monotonic() + timeout_s
    while any(_threads(group)) and time.monotonic() < end:
        time.sleep(0.01)


def _threads(group: int) -> Iterator[int]:
    """Yields the number of threads of each running process of the group."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                # After the name, which may hold anything: state, parent, group, and the threads as the 18th.
                fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            except OSError:  # ended meanwhile
                continue
            if int(fields[2]) == group and fields[0] not in (b"Z", b"X"):
                yield int(fields[17])
