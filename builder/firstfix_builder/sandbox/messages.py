"""Messages between a sandboxed build and the worker outside: one JSON object on each line, over two pipes.

to the build    {"job": {...}}, {"cancel": true}, {"answer": ...} to the last "fetch", "share" or
                "provisional"
from the build  {"confined": [what the kernel cannot confine]}, {"stage": name, "done": 0..1},
                {"cached": stage}, {"chunks": [stage, number, reused]}, {"fetch": key},
                {"share": [key, stage, folder]}, {"provisional": true}: publish it,
                {"built": true} or {"failed": {"code", "detail"}}
"""

from __future__ import annotations

import json
import os
import select
import threading
import time
from typing import Any

from firstfix.errors import BuildFailed

MAX_LINE_BYTES = 256 << 10


class MessageReader:
    """Reads messages from a pipe. For use by one thread."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._buffer = b""

    def next(self, timeout_s: float) -> dict[str, Any] | None:
        """The next message, or None if none arrives in time.

        Raises:
            EOFError: the other side has closed.
            BuildFailed: the message is malformed or too long.
        """
        end = time.monotonic() + timeout_s
        while b"\n" not in self._buffer:
            if len(self._buffer) > MAX_LINE_BYTES:
                raise BuildFailed(f"the build sent a message of over {MAX_LINE_BYTES} bytes")
            readable, _, _ = select.select([self._handle], [], [], max(end - time.monotonic(), 0.0))
            if not readable:
                return None
            arrived = os.read(self._handle, 64 << 10)
            if not arrived:
                raise EOFError
            self._buffer += arrived
        line, _, self._buffer = self._buffer.partition(b"\n")
        try:
            message = json.loads(line)
        except ValueError:
            message = None
        if not isinstance(message, dict) or len(message) == 0:
            raise BuildFailed("the build sent a message of no known form")
        return message


class MessageWriter:
    """Writes messages to a pipe. Thread-safe."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._lock = threading.Lock()

    def send(self, **message: Any) -> None:
        """Send a message.

        Raises:
            BrokenPipeError: the other side has closed.
        """
        line = json.dumps(message).encode() + b"\n"
        with self._lock:
            while line:
                line = line[os.write(self._handle, line) :]
