"""Limits of one build where nobody has set others."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

DEFAULT_MAX_TEMPLATES = 4_000_000  # two hours of two processors, 11 GB of disk: lab/docs/large-maps.md

_CGROUPS = Path("/sys/fs/cgroup")
_OF_THIS_PROCESS = Path("/proc/self/cgroup")
_LIMIT_FILES = ("memory.max", "memory/memory.limit_in_bytes")  # of cgroups version 2 and 1


def default_build_memory_bytes() -> int:
    """Half of the memory that this process may take: of the machine, or of its container."""
    return memory_bytes() // 2


def memory_bytes(cgroups: Path = _CGROUPS, of_this_process: Path = _OF_THIS_PROCESS) -> int:
    """The memory of the machine, or the limit of this process's cgroup where that is less."""
    found = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for folder in _folders(cgroups, of_this_process):
        for name in _LIMIT_FILES:
            with suppress(OSError, ValueError):  # no such file, or "max"
                found.append(int((folder / name).read_text()))
    return min(found)


def _folders(cgroups: Path, of_this_process: Path) -> list[Path]:
    """The cgroup of this process and all around it. A container sees its own as the root."""
    with suppress(OSError):
        for line in of_this_process.read_text().splitlines():
            _, kinds, path = line.split(":", 2)
            if kinds == "":  # version 2
                own = cgroups / path.strip("/")
                return [own, *(one for one in own.parents if one.is_relative_to(cgroups))]
    return [cgroups]
