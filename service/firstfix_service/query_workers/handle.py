"""The service's end of one worker process."""

from __future__ import annotations

import os
import select
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

from firstfix.answer.localization import Localization
from firstfix.errors import FirstfixError

from .process import DROP, HELLO, LOAD
from .query import Query, ServedVersion

LOAD_WITHIN_S = 300.0
STALLED_S = 30.0  # a message that stops half-way: the process was stopped, or thrashes
# One query is one thread's work; the processes share the cores.
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class WorkerDied(Exception):
    """The process is gone, or was killed as it did not answer."""


class WorkerStuck(Exception):
    """The query took too long, and the process was killed."""


class WorkerDefect(Exception):
    """An error in the worker that is not ours: its traceback."""


class WorkerHandle:
    """One process. ``answer`` is for one thread at a time, the rest for any."""

    def __init__(self) -> None:
        """Starts it; it is up a second later."""
        queries, its_queries = socket.socketpair()
        control, its_control = socket.socketpair()
        for end in (queries, control):
            for option in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
                end.setsockopt(socket.SOL_SOCKET, option, struct.pack("ll", int(STALLED_S), 0))
        with its_queries, its_control:
            ends = (its_queries.fileno(), its_control.fileno())
            self._process = subprocess.Popen(
                [sys.executable, "-m", "firstfix_service.query_workers.process", *map(str, ends)],
                pass_fds=ends,
                stdin=subprocess.DEVNULL,
                env={**dict.fromkeys(_ONE_THREAD, "1"), **os.environ},
            )
        self._queries = Connection(queries.detach())
        self._control = Connection(control.detach())
        self._replies = select.poll()  # ready made: ``Connection.poll`` makes one for every call
        self._replies.register(self._queries.fileno(), select.POLLIN)
        self._query_lock = threading.Lock()  # until ``close``, or another file might have got its number
        self._control_lock = threading.Lock()
        self.started = time.monotonic()

    @property
    def pid(self) -> int:
        return self._process.pid

    def wait_until_up(self) -> None:
        """
        Raises:
            WorkerDied: it ended, or did not come up.
        """
        self._tell(HELLO, None)

    def answer(self, query: Query, timeout_s: float) -> Localization:
        """
        Raises:
            WorkerDied: before it answered.
            WorkerStuck: not within the time.
            FirstfixError, WorkerDefect: the query's.
        """
        try:
            with self._query_lock:
                self._queries.send(replace(query, body=b""))
                self._queries.send_bytes(query.body)
                reply = self._queries.recv() if self._replies.poll(timeout_s * 1e3) else None
        except (EOFError, OSError) as error:
            self.kill()  # if it only stalled
            raise WorkerDied(repr(error)) from None
        if reply is None:
            self.kill()
            raise WorkerStuck(f"over {timeout_s:g} s")
        answer: Localization = _unwrap(reply)
        return answer

    def load(self, version: ServedVersion) -> int:
        """
        Raises:
            WorkerDied: over it, or it took too long.
            FirstfixError, WorkerDefect: the version's.
        """
        return int(self._tell(LOAD, version))

    def drop(self, version: ServedVersion) -> None:
        """A process that is gone has dropped it too."""
        with suppress(WorkerDied):
            self._tell(DROP, version)

    def wait(self) -> int:
        """Blocks until the process ends; its exit status, negative a signal's number."""
        return self._process.wait()

    def kill(self) -> None:
        self._process.kill()

    def close(self) -> None:
        """For when it has ended."""
        with self._query_lock:
            self._queries.close()
        with self._control_lock:
            self._control.close()

    def _tell(self, what: str, version: ServedVersion | None) -> Any:
        with self._control_lock:
            try:
                self._control.send((what, version))
                reply = self._control.recv() if self._control.poll(LOAD_WITHIN_S) else None
            except (EOFError, OSError) as error:
                self.kill()
                raise WorkerDied(repr(error)) from None
        if reply is None:
            self.kill()
            raise WorkerDied(f"it did not answer within {LOAD_WITHIN_S:g} s")
        return _unwrap(reply)


def _unwrap(reply: tuple[bool, Any]) -> Any:
    good, value = reply
    if good:
        return value
    raise value if isinstance(value, FirstfixError) else WorkerDefect(value)
