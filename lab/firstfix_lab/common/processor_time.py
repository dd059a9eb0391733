"""Processor time of a process and all that it started: a build works in several processes."""

from __future__ import annotations

import os
from pathlib import Path

from .memory import descendants

_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def cpu_s_of_family(pid: int) -> float:
    """The processor seconds of a process, its descendants, and those of them that ended (Linux)."""
    return sum(_ticks(one) for one in (pid, *descendants(pid))) / _TICKS_A_SECOND


def _ticks(pid: int) -> int:
    """User and system time of a process, and of its children that it has waited for."""
    try:
        # After the name, which may hold anything: state, parent, and from the twelfth on the four times.
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:  # it has ended
        return 0
    return sum(map(int, fields[11:15]))
