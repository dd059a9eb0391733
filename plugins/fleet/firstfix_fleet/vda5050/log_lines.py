"""Lines of the log, so many a second: strangers must not fill a disk with what they publish."""

from __future__ import annotations

from collections.abc import Callable

MAX_IN_A_SECOND = 50
MAX_CHARS = 500


class LogLines:
    """Writes lines while there are few; counts those that are left out.

    Args:
        write: takes the name of a vehicle, or none, and a line.
    """

    def __init__(self, write: Callable[[str, str], None], clock: Callable[[], float]) -> None:
        self._write, self._clock = write, clock
        self._second, self._written, self._left_out = 0, 0, 0

    def write(self, name: str, line: str) -> None:
        """Write a line, or count it. What strangers chose in it is shown without control characters."""
        second = int(self._clock())
        if second != self._second:
            if self._left_out:
                self._write(
                    "", f"{self._left_out} lines were left out: more than {MAX_IN_A_SECOND} in a second"
                )
            self._second, self._written, self._left_out = second, 0, 0
        if self._written >= MAX_IN_A_SECOND:
            self._left_out += 1
            return
        self._written += 1
        self._write(_shown(name), _shown(line))


def _shown(text: str) -> str:
    return "".join(sign if sign.isprintable() else "?" for sign in text[:MAX_CHARS])
