"""A process for a library that a damaged file may crash, hang or fill: it has limits of memory and time.

The process starts with the first job, and ends with its owner. What goes in and comes out is copied.
"""

from __future__ import annotations

import resource
import signal
import time
import weakref
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any, ClassVar, Generic, TypeVar

from ..errors import FirstfixError, MalformedData, TooLarge

MAX_MEMORY_BYTES = 4 << 30
MAX_PROCESSOR_S = 120  # of one job: a large capture is searched as a whole for its sensors
MAX_WAIT_S = 900.0  # of one job that uses no processor, on a busy machine
_Result = TypeVar("_Result")
_Job = tuple[int, Callable[..., Any] | None, tuple[Any, ...]]  # number of a talk (0: none), what, with what


@dataclass(frozen=True)
class Limits:
    """Limits of a confined process.

    Attributes:
        memory_bytes: private memory that it may reserve, used or not.
        processor_s: seconds of a processor for one job.
        wait_s: seconds for one job, by the clock.
    """

    memory_bytes: int = MAX_MEMORY_BYTES
    processor_s: int = MAX_PROCESSOR_S
    wait_s: float = MAX_WAIT_S


class ConfinedProcess:
    """One process for functions, which starts anew where it has ended. Thread-safe.

    Functions are those of modules, and what they take and give can be pickled. All methods raise what the
    function raises of this project's errors, and ModuleNotFoundError; and

    MalformedData: the process crashed, or took longer than it may.
    TooLarge: it needs more memory than it may.
    """

    def __init__(self, limits: Limits = Limits()) -> None:
        self._limits = limits
        self._lock = Lock()
        self._numbers = count(1)
        self._running: _Running | None = None

    def run(self, function: Callable[..., _Result], *arguments: Any) -> _Result:
        """Call a function there."""
        result: _Result = self._ask((0, function, arguments))
        return result

    def talk(self, function: Callable[..., Iterator[_Result]], *arguments: Any) -> Talk[_Result]:
        """Begin a generator there."""
        number = next(self._numbers)
        self._ask((number, function, arguments))
        return Talk(self, number)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            if self._running is not None:
                self._running.end()
                self._running = None

    def _ask(self, job: _Job) -> Any:
        with self._lock:
            if self._running is None:
                self._running = _Running(self._limits)
                weakref.finalize(self, self._running.end)
            try:
                ok, result = self._running.ask(job)
            except (EOFError, OSError):
                self._running.end()
                self._running = None
                limits = self._limits
                raise MalformedData(
                    f"its reader crashed, or took more than {limits.processor_s} s of processor time or "
                    f"{limits.wait_s:.0f} s"
                ) from None
        if ok:
            return result
        raise result


class Talk(Generic[_Result]):
    """A generator in a confined process, see ``ConfinedProcess``."""

    def __init__(self, process: ConfinedProcess, number: int) -> None:
        self._process, self._number = process, number

    def send(self, value: Any = None) -> _Result:
        """The next of its results; the value is what its ``yield`` gives.

        Raises:
            StopIteration: it has ended.
        """
        ended, result = self._process._ask((self._number, None, (value,)))
        if ended:
            raise StopIteration
        return result

    def __iter__(self) -> Talk[_Result]:
        return self

    def __next__(self) -> _Result:
        return self.send()


class _Running:
    """The process of the moment, and its connection."""

    _context: ClassVar[Any] = get_context("spawn")  # not a copy of this process, whose threads hold locks

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._connection, there = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(there, limits), daemon=True)
        self._process.start()
        there.close()

    def ask(self, job: _Job) -> tuple[bool, Any]:
        """Send a job. Returns whether it was done, and its result or its error."""
        self._connection.send(job)
        if not self._connection.poll(self._limits.wait_s):
            raise EOFError
        answer: tuple[bool, Any] = self._connection.recv()
        return answer

    def end(self) -> None:
        """Kill the process."""
        self._connection.close()
        self._process.kill()
        self._process.join()


def _serve(connection: Connection, limits: Limits) -> None:
    """Do jobs until the owner is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    memory = limits.memory_bytes if hard == resource.RLIM_INFINITY else min(hard, limits.memory_bytes)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    talks: dict[int, Generator[Any, Any, None]] = {}
    with suppress(EOFError, OSError):
        while True:
            job = connection.recv()
            until_s = int(time.process_time()) + limits.processor_s + 1
            resource.setrlimit(resource.RLIMIT_CPU, (until_s, resource.RLIM_INFINITY))
            connection.send(_done(job, talks, memory))


def _done(job: _Job, talks: dict[int, Generator[Any, Any, None]], memory_bytes: int) -> tuple[bool, Any]:
    number, function, arguments = job
    try:
        if not number:
            assert function is not None
            return True, function(*arguments)
        if function is not None:
            talks[number] = function(*arguments)
            return True, None
        if number not in talks:
            raise MalformedData("its reader has ended")
        try:
            return True, (False, talks[number].send(*arguments))
        except StopIteration:
            del talks[number]
            return True, (True, None)
    except (FirstfixError, ModuleNotFoundError) as error:
        return False, error
    except MemoryError:
        return False, TooLarge(f"its reader needs more than {memory_bytes} bytes of memory")
    except Exception as error:
        return False, MalformedData(str(error) or type(error).__name__)
