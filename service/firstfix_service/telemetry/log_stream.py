"""Log stream whose writers never wait for its reader.

Who reads the log may stop: a frozen collector, a full pipe, a hung disk. A write would then wait for it, and
with it the event loop and all requests. So lines go to a thread of their own, through a bounded queue. Lines
for which there is no room are lost and counted.
"""

from __future__ import annotations

import atexit
import os
import threading
import time
from collections import deque
from contextlib import suppress

MAX_BYTES = 4 << 20  # of lines that wait for the reader
MAX_WRITE_BYTES = 64 << 10  # lines that are written together
GATHER_S = 0.005  # in which lines are gathered for one write
LAST_LINES_WITHIN_S = 2.0  # of the process


class LogStream:
    """A text stream that writes to a file descriptor in a thread of its own. Thread-safe."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0  # with those that are being written
        self._lost = 0
        self._changed = threading.Condition()
        threading.Thread(target=self._run, name="log", daemon=True).start()
        atexit.register(self.drain, LAST_LINES_WITHIN_S)

    def write(self, text: str) -> int:
        """Queues whole lines, or drops them if too many wait. Never blocks."""
        line = text.encode("utf-8", "backslashreplace")
        with self._changed:
            if self._waiting_bytes + len(line) > MAX_BYTES:
                self._lost += 1
            else:
                self._waiting.append(line)
                self._waiting_bytes += len(line)
                self._changed.notify_all()
        return len(text)

    def flush(self) -> None:
        """Does nothing: the thread writes as fast as the reader takes it."""

    def drain(self, within_s: float) -> None:
        """Waits until all lines are written, or for ``within_s``."""
        with self._changed:
            self._changed.wait_for(lambda: not self._waiting_bytes, within_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)
            time.sleep(GATHER_S)
            lines, size = self._take()
            self._write(lines)
            with self._changed:
                self._waiting_bytes -= size
                self._changed.notify_all()

    def _take(self) -> tuple[bytes, int]:
        """Returns the next lines, with a line about lost ones, and the bytes that were counted for them."""
        with self._changed:
            lines = [self._waiting.popleft()]
            size = len(lines[0])
            while self._waiting and size + len(self._waiting[0]) <= MAX_WRITE_BYTES:
                lines.append(self._waiting.popleft())
                size += len(lines[-1])
            lost, self._lost = (self._lost, 0) if not self._waiting else (0, self._lost)
        if lost:
            lines.append(b'{"event": "log lines were lost: its reader was too slow", "lines": %d}\n' % lost)
        return b"".join(lines), size

    def _write(self, lines: bytes) -> None:
        rest = memoryview(lines)
        with suppress(OSError):  # a full disk, or a reader that has gone
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
