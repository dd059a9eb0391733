"""Exit codes of a build's process, by which its runner knows what to do next."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """Exit code of ``python -m firstfix_builder.worker``; the last ones have the numbers of sysexits.h."""

    SUCCEEDED = 0
    FAILED = 1  # the status has the reason
    USAGE = 2
    CANCELLED = 3
    NO_SPACE = 73  # the store or the work folder is full: run it again a few times
    TRY_AGAIN = 75  # it was stopped, or the store or the cluster is out of reach: run it again
