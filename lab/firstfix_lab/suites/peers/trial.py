"""One peer in a process of its own, so that a scan that takes too long can be ended."""

from __future__ import annotations

import multiprocessing
import os
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Protocol

from firstfix.scan.scan import Scan

from ...common.memory import descendants, peak_bytes_of_family
from ...common.processor_time import cpu_s_of_family
from .answer import Answer
from .peer_input import PeerInput
from .prior import Prior

LIMIT_S = 60.0


class Peer(Protocol):
    """A system that localizes scans. Its preparation of the map is timed apart from its answers."""

    def __init__(self, given: PeerInput) -> None: ...

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        """The best pose."""
        ...

    @staticmethod
    def sent_bytes(given: PeerInput, scan: Scan) -> int:
        """Number of bytes that a robot sends of a scan."""
        ...


@dataclass(frozen=True)
class Found:
    """Answer of a peer, and what it took.

    Attributes:
        seconds: LIMIT_S where it was ended, or crashed.
        cpu_s: processor time of all its threads and processes.
    """

    answer: Answer
    seconds: float
    cpu_s: float


@dataclass(frozen=True)
class Preparation:
    """Cost of getting a peer ready for a map.

    Attributes:
        peak_bytes: of memory, until it was ready.
    """

    seconds: float
    cpu_s: float
    peak_bytes: int


class Trial:
    """Asks a peer, scan after scan.

    Attributes:
        preparation: of the peer, when it was made last.
        peak_bytes: of memory, preparation included, over all answers so far.
    """

    def __init__(self, make: type[Peer], given: PeerInput) -> None:
        self._make, self._given = make, given
        self.peak_bytes = 0

    def __enter__(self) -> Trial:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._make, self._given), daemon=True)
        self._process.start()
        theirs.close()
        seconds, cpu_s = self._pipe.recv()
        self.preparation = Preparation(seconds, cpu_s, self._watch_memory())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.join()
        self._pipe.close()

    def ask(self, scan: Scan, prior: Prior) -> Found:
        """Ask the peer for a pose.

        Raises:
            RuntimeError: the peer raised, which is the suite's fault; native code that crashes is its own.
        """
        before_s = cpu_s_of_family(self._pid)
        self._pipe.send((scan, prior))
        try:
            if self._pipe.poll(LIMIT_S):
                found: Found = self._pipe.recv()
                self._watch_memory()
                return found
        except EOFError:
            self._process.join()
            if (self._process.exitcode or 0) > 0:
                raise RuntimeError(f"{self._make.__name__} raised: see above") from None
        self._watch_memory()
        took_s = max(0.0, cpu_s_of_family(self._pid) - before_s)  # a process that crashed has none any more
        self.__exit__(None, None, None)
        self.__enter__()
        return Found(Answer(), LIMIT_S, took_s)

    @property
    def _pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    def _watch_memory(self) -> int:
        now = peak_bytes_of_family(self._pid)
        self.peak_bytes = max(self.peak_bytes, now)
        return now


def _serve(pipe: Connection, make: type[Peer], given: PeerInput) -> None:
    began, began_cpu_s = time.perf_counter(), _cpu_s()
    peer = make(given)
    pipe.send((time.perf_counter() - began, _cpu_s() - began_cpu_s))
    while True:
        scan, prior = pipe.recv()
        began, began_cpu_s = time.perf_counter(), _cpu_s()
        answer = peer(scan, prior)
        pipe.send(Found(answer, time.perf_counter() - began, _cpu_s() - began_cpu_s))


def _cpu_s() -> float:
    """Of this process, finer than the kernel's ticks, and of those that it started."""
    return time.process_time() + sum(map(cpu_s_of_family, descendants(os.getpid())))
