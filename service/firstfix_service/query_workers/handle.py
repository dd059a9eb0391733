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
STALLED_S = 30.0  # for a message to go on: then the process was stopped, or it swaps
# Each query runs in one thread; the processes share the cores.
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class QueryWorkerDied(Exception):
    """The process ended, or was killed because it did not answer."""


class QueryWorkerStuck(Exception):
    """The query took too long; the process was killed."""


class QueryWorkerDefect(Exception):
    """An unexpected error in the worker, with its traceback as text."""


class QueryWorkerHandle:
    """One worker process. One thread at a time may call ``answer``; any thread may call the rest."""

    def __init__(self) -> None:
        """Starts the process. It takes a second until it is up."""
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
        self._replies = select.poll()  # kept: ``Connection.poll`` makes one for every call
        self._replies.register(self._queries.fileno(), select.POLLIN)
        self._query_lock = threading.Lock()  # held by ``close`` too, or another file could get its number
        self._control_lock = threading.Lock()
        self.started = time.monotonic()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def wait_until_up(self) -> None:
        """Blocks until the process can answer.

        Raises:
            QueryWorkerDied: it ended, or did not start in time.
        """
        self._tell(HELLO, None)

    def answer(self, query: Query, timeout_s: float) -> Localization:
        """Returns the process's answer to a query.

        Raises:
            QueryWorkerDied: the process ended before it answered.
            QueryWorkerStuck: no answer within the time.
            FirstfixError, QueryWorkerDefect: the query failed.
        """
        try:
            with self._query_lock:
                self._queries.send(replace(query, body=b""))
                self._queries.send_bytes(query.body)
                reply = self._queries.recv() if self._replies.poll(timeout_s * 1e3) else None
        except (EOFError, OSError) as error:
            self.kill()  # it may only have stalled
            raise QueryWorkerDied(repr(error)) from None
        if reply is None:
            self.kill()
            raise QueryWorkerStuck(f"over {timeout_s:g} s")
        answer: Localization = _unwrap(reply)
        return answer

    def load(self, version: ServedVersion) -> int:
        """Loads a version; returns its bytes in memory, without mapped files.

        Raises:
            QueryWorkerDied: the process ended over it, or it took too long.
            FirstfixError, QueryWorkerDefect: the version cannot be loaded.
        """
        return int(self._tell(LOAD, version))

    def drop(self, version: ServedVersion) -> None:
        """Unloads a version. Does nothing if the process has ended."""
        with suppress(QueryWorkerDied):
            self._tell(DROP, version)

    def wait(self) -> int:
        """Blocks until the process ends; returns its exit status, the negative number of a signal."""
        return self._process.wait()

    def kill(self) -> None:
        """Ends the process at once."""
        self._process.kill()

    def close(self) -> None:
        """Closes the sockets of a process that has ended."""
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
                raise QueryWorkerDied(repr(error)) from None
        if reply is None:
            self.kill()
            raise QueryWorkerDied(f"it did not answer within {LOAD_WITHIN_S:g} s")
        return _unwrap(reply)


def _unwrap(reply: tuple[bool, Any]) -> Any:
    good, value = reply
    if good:
        return value
    raise value if isinstance(value, FirstfixError) else QueryWorkerDefect(value)
