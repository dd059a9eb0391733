"""The memory of a process group, as /proc tells it: what the kernel cannot drop when it runs short.

Not by RLIMIT_AS: it is of one process, and a build reserves several times what it touches (a small one has
1.6 GB of addresses and 0.4 GB of memory). Not by cgroups: few containers let a process make its own.
"""

from __future__ import annotations

import re
from pathlib import Path

_PRIVATE = re.compile(rb"^(?:RssAnon|RssShmem):\s+(\d+) kB$", re.M)


def group_memory_bytes(group: int) -> int:
    """Anonymous and shared memory of all processes of the group; mapped files do not count."""
    total = 0
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            # After the name, which may hold anything: state, parent, group.
            fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[2]) == group:
                total += sum(int(kib) << 10 for kib in _PRIVATE.findall((folder / "status").read_bytes()))
        except (OSError, IndexError, ValueError):  # ended meanwhile
            continue
    return total
