"""The service's end of one worker process."""

from __future__ import annotations

import asyncio
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from firstfix.errors import DeadlineExceeded, FirstfixError, TooLarge

from .base import QueryWorkerDied
from .look import Answered, Asked
from .protocol import DROP, HELLO, INLINE_BYTES, LOAD, TAKE, WARM, BodyMemory, MessageReader, message_of
from .query import ServedVersion
from .sightings.counter import Sighted

LOAD_WITHIN_S = 300.0
FREE_WITHIN_S = 1.0  # for a process that loads a version, to be asked for its sightings
STALLED_S = 30.0  # for a control message to go on: then the process was stopped, or it swaps
# Each query runs in one thread; the processes share the cores.
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class QueryWorkerDefect(Exception):
    """An unexpected error in the worker, with its traceback as text."""


class QueryWorkerHandle:
    """One worker process. One query at a time may use ``answer``; any thread may call the rest.

    Args:
        query_timeout_s: a query that runs longer fails, and the process is killed.
        max_body_bytes: largest body of a query, with and without its content encoding.
        counts_sightings: of localized queries.

    Attributes:
        is_alive: False once it is known to have ended, or to end.
    """

    def __init__(self, query_timeout_s: float, max_body_bytes: int, *, counts_sightings: bool) -> None:
        """Start the process. It takes a second until it is up."""
        self.is_alive = True
        self._query_timeout_s = query_timeout_s
        self._bodies = BodyMemory(max_body_bytes)
        queries, its_queries = socket.socketpair()
        control, its_control = socket.socketpair()
        queries.setblocking(False)
        for option in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
            control.setsockopt(socket.SOL_SOCKET, option, struct.pack("ll", int(STALLED_S), 0))
        self._queries, self._control = queries, Connection(control.detach())
        with its_queries, its_control:
            ends = (its_queries.fileno(), its_control.fileno(), self._bodies.descriptor)
            self._process = subprocess.Popen(
                [sys.executable, "-m", "firstfix_service.query_workers.worker"]
                + [str(number) for number in (*ends, max_body_bytes, int(counts_sightings))],
                pass_fds=ends,
                stdin=subprocess.DEVNULL,
                env={**dict.fromkeys(_ONE_THREAD, "1"), **os.environ},
            )
        self._reader = MessageReader()
        self._loop: asyncio.AbstractEventLoop | None = None  # that reads the replies
        self._reply: _Reply | None = None  # to the query under way
        self._body_bytes, self._number = 0, 0  # of that query
        self._timer: asyncio.TimerHandle
        self._query_lock = threading.Lock()  # held by ``close`` too, or another file could get its number
        self._control_lock = threading.Lock()
        self.started = time.monotonic()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def wait_until_up(self) -> None:
        """Block until the process can answer.

        Raises:
            QueryWorkerDied: it ended, or did not start in time.
        """
        self._request(HELLO, None)

    def answer(self, asked: Asked) -> asyncio.Future[Answered]:
        """The process's answer to a query or a look. It is a plain future: a task for each takes longer.

        The future raises:
            QueryWorkerDied: the process ended before it answered.
            DeadlineExceeded: no answer within ``query_timeout_s``.
            TooLarge: the body has more than ``max_body_bytes``.
            FirstfixError, QueryWorkerDefect: the query failed.
            QueryCancelled: as ``cancel``.
        """
        loop = asyncio.get_running_loop()
        reply = _Reply(self._given_up, loop)
        if not self._query_lock.acquire(blocking=False):
            reply.set_exception(QueryWorkerDied("it is being closed"))
            return reply
        self._reply, self._body_bytes, self._number = reply, len(asked.body), self._number + 1
        self._timer = loop.call_later(self._query_timeout_s, self._stuck)
        try:
            self._begin_to_read(loop)
            self._send(asked)
        except TooLarge as error:  # nothing was sent
            self._reply_ended(reply).set_exception(error)
        except Exception as error:
            self._fail(error)
        return reply

    def cancel(self, answer: asyncio.Future[Answered]) -> None:
        """Let the query of an answer end, if it is still under way."""
        if answer is self._reply:
            self._bodies.cancel(self._number)

    def load(self, version: ServedVersion) -> int:
        """Load a version; returns its bytes in memory, without mapped files.

        Raises:
            QueryWorkerDied: the process ended over it, or it took too long.
            FirstfixError, QueryWorkerDefect: the version cannot be loaded.
        """
        return int(self._request(LOAD, version))

    def warm_up(self, version: ServedVersion) -> int:
        """Ask a version about scans of its own map, unless the process did so before.

        Returns:
            The number of these queries.

        Raises:
            QueryWorkerDied: the process ended over it, or it took too long.
            FirstfixError, QueryWorkerDefect: a query failed.
        """
        return int(self._request(WARM, version))

    def drop(self, version: ServedVersion) -> None:
        """Unload a version. Does nothing if the process has ended."""
        with suppress(QueryWorkerDied):
            self._request(DROP, version)

    def take_sightings(self) -> Sighted:
        """Counts of the process; none if it has ended or loads a version now."""
        if not self._control_lock.acquire(timeout=FREE_WITHIN_S):
            return Sighted()
        try:
            taken: Sighted = self._request_locked(TAKE, None)
        except QueryWorkerDied:
            return Sighted()
        finally:
            self._control_lock.release()
        return taken

    def wait(self) -> int:
        """Block until the process ends; returns its exit status, the negative number of a signal."""
        status = self._process.wait()
        self.is_alive = False
        return status

    def kill(self) -> None:
        """End the process at once."""
        self.is_alive = False
        self._process.kill()

    def close(self) -> None:
        """Close the sockets and the memory of a process that has ended."""
        with self._query_lock:
            self._bodies.close()
            if self._loop is None:
                self._queries.close()
            else:
                try:
                    self._loop.call_soon_threadsafe(self._stop_reading)
                except RuntimeError:  # the loop has ended with the service
                    self._queries.close()
        with self._control_lock:
            self._control.close()

    def _send(self, asked: Asked) -> None:
        """Send a query or a look. The process waits, so there is room for the whole message in its socket.

        Raises:
            OSError: the process has ended, or does not read.
        """
        if len(asked.body) > INLINE_BYTES:
            self._bodies.write(asked.body)
        parts = message_of(asked, self._number)
        if self._queries.sendmsg(parts) < sum(map(len, parts)):
            raise BlockingIOError("it does not read")

    def _begin_to_read(self, loop: asyncio.AbstractEventLoop) -> None:
        """Read the replies in the loop, from the first query on."""
        if self._loop is None:  # to begin to read, and to stop, takes longer than a reply
            self._loop = loop
            loop.add_reader(self._queries, self._read)

    def _stuck(self) -> None:
        self._fail(DeadlineExceeded(f"the query was stopped: it ran for over {self._query_timeout_s:g} s"))

    def _fail(self, error: Exception) -> None:
        """End the process, and the query under way with the error. It may only have stalled."""
        self.kill()
        if (reply := self._reply) is not None:
            is_end = isinstance(error, (EOFError, OSError))
            self._reply_ended(reply).set_exception(QueryWorkerDied(repr(error)) if is_end else error)

    def _given_up(self, reply: _Reply) -> None:
        """End the process if nobody waits for its reply any more: it must not answer the next query."""
        if reply is self._reply:
            self._reply_ended(reply)
            self.kill()

    def _reply_ended(self, reply: _Reply) -> _Reply:
        """Let the next query come."""
        self._timer.cancel()
        self._reply = None
        self._query_lock.release()
        return reply

    def _read(self) -> None:
        """Read what the process has sent."""
        try:
            received = self._reader.receive(self._queries)
        except (BlockingIOError, InterruptedError):
            return
        except Exception as error:
            self._stop_reading()
            self._fail(error)
            return
        if received is None:
            return
        self._reader.forget()
        if (reply := self._reply) is None:
            return
        self._bodies.trim(self._body_bytes)
        self._reply_ended(reply)
        good, value = received[0]
        if good:
            reply.set_result(value)
        else:
            reply.set_exception(_error_of(value))

    def _stop_reading(self) -> None:
        """Close the socket, in the loop that reads from it: another file could get its number."""
        if self._loop is not None and self._queries.fileno() >= 0:
            self._loop.remove_reader(self._queries)
            self._queries.close()

    def _request(self, what: str, version: ServedVersion | None) -> Any:
        with self._control_lock:
            return self._request_locked(what, version)

    def _request_locked(self, what: str, version: ServedVersion | None) -> Any:
        """The reply to a control message. The caller holds the lock."""
        try:
            self._control.send((what, version))
            reply = self._control.recv() if self._control.poll(LOAD_WITHIN_S) else None
        except (EOFError, OSError) as error:
            self.kill()
            raise QueryWorkerDied(repr(error)) from None
        if reply is None:
            self.kill()
            raise QueryWorkerDied(f"it did not answer within {LOAD_WITHIN_S:g} s")
        good, value = reply
        if not good:
            raise _error_of(value)
        return value


class _Reply(asyncio.Future[Answered]):
    """The reply to a query.

    Args:
        given_up: called when nobody waits for it any more.
    """

    def __init__(self, given_up: Callable[[_Reply], None], loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(loop=loop)
        self._given_up = given_up

    def cancel(self, msg: Any | None = None) -> bool:
        """Give the reply up."""
        is_given_up = super().cancel(msg)
        if is_given_up:
            self._given_up(self)
        return is_given_up


def _error_of(value: Any) -> Exception:
    return value if isinstance(value, FirstfixError) else QueryWorkerDefect(value)
