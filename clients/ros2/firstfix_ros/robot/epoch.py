"""Epoch of a fix: tells a new first fix from the same one that is sent again."""

from __future__ import annotations

from dataclasses import dataclass

_VERSION_CHARACTERS = 12  # of the digest: enough to tell the versions of a map apart


@dataclass(frozen=True)
class Epoch:
    """Identity of a fix that a robot was given. It stays the same however often the pose is published.

    Attributes:
        robot: the robot's namespace.
        map_version: digest of the version that answered.
        number: ascends with every new fix of the robot, also over restarts of a gateway without a memory: the
            second since 1970 in which the fix was found, or one more than the number before.
    """

    robot: str
    map_version: str
    number: int

    def __str__(self) -> str:
        return f"{self.robot or '/'}:{self.map_version[:_VERSION_CHARACTERS]}:{self.number}"


def next_number(last: int | None, now_ns: int) -> int:
    """The number of a new epoch, after the last one and at a time since 1970."""
    now_s = now_ns // 10**9
    return now_s if last is None else max(last + 1, now_s)
