"""Peak memory of the processes that a block starts, added up: a build works in several at once."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from types import TracebackType

POLL_S = 0.2


class PeakMemory:
    """Samples the proportional set size of all descendants of this process (Linux)."""

    def __enter__(self) -> PeakMemory:
        self.peak_bytes = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(POLL_S):
            self.peak_bytes = max(self.peak_bytes, memory_of_children())


def memory_of_children() -> int:
    """Bytes of all descendants of this process, what they share counted once (Linux)."""
    return sum(map(_pss_bytes, descendants(os.getpid())))


def pss_of_family(pid: int) -> int:
    """Bytes of a process and all that it started."""
    return sum(map(_pss_bytes, [pid, *descendants(pid)]))


def descendants(pid: int) -> list[int]:
    """The processes that a process started, and that these started (Linux)."""
    found: list[int] = []
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                found += [int(child), *descendants(int(child))]
    except OSError:  # it has ended
        pass
    return found


def own_bytes(pid: int) -> int:
    """Bytes of a process that are no pages of files (Linux)."""
    return _pss_bytes(pid, "Pss_Anon:")


def _pss_bytes(pid: int, kind: str = "Pss:") -> int:
    try:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith(kind):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 0


def peak_bytes_of_family(pid: int) -> int:
    """Bytes of resident memory that a process and those that it started had at most, each at its own time."""
    return sum(map(_peak_bytes, [pid, *descendants(pid)]))


def _peak_bytes(pid: int) -> int:
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:  # it has ended
        pass
    return 0
