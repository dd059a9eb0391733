"""One peer in a process of its own, so that a scan that takes too long can be ended."""

from __future__ import annotations

import multiprocessing
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.scan import Scan
from firstfix.transform import Matrix

from .peer_input import PeerInput

LIMIT_S = 60.0


class Peer(Protocol):
    """A system that localizes scans. Its preparation of the map is timed apart from its answers."""

    def __init__(self, given: PeerInput) -> None: ...

    def __call__(self, scan: Scan, gravity: NDArray[np.float64]) -> Matrix | None:
        """Returns the (4, 4) pose T_map_sensor, or None: no answer.

        Args:
            gravity: (3,) unit vector in the sensor frame, pointing down.
        """
        ...


@dataclass(frozen=True)
class Found:
    """Answer of a peer.

    Attributes:
        T_map_sensor: (4, 4), or None: no answer.
        seconds: LIMIT_S where it was ended, or crashed.
    """

    T_map_sensor: Matrix | None
    seconds: float


class Trial:
    """Asks a peer, scan after scan.

    Attributes:
        preparation_s: time that the peer took for the map, when it was made last.
    """

    def __init__(self, make: type[Peer], given: PeerInput) -> None:
        self._make, self._given = make, given

    def __enter__(self) -> Trial:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._make, self._given), daemon=True)
        self._process.start()
        theirs.close()
        self.preparation_s: float = self._pipe.recv()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.join()
        self._pipe.close()

    def ask(self, scan: Scan, gravity: NDArray[np.float64]) -> Found:
        """Asks the peer for a pose.

        Raises:
            RuntimeError: the peer raised, which is the suite's fault; native code that crashes is its own.
        """
        self._pipe.send((scan, gravity))
        try:
            if self._pipe.poll(LIMIT_S):
                return self._pipe.recv()
        except EOFError:
            self._process.join()
            if (self._process.exitcode or 0) > 0:
                raise RuntimeError(f"{self._make.__name__} raised: see above") from None
        self.__exit__(None, None, None)
        self.__enter__()
        return Found(None, LIMIT_S)


def _serve(pipe: Connection, make: type[Peer], given: PeerInput) -> None:
    began = time.perf_counter()
    peer = make(given)
    pipe.send(time.perf_counter() - began)
    while True:
        scan, gravity = pipe.recv()
        began = time.perf_counter()
        T_map_sensor = peer(scan, gravity)
        pipe.send(Found(T_map_sensor, time.perf_counter() - began))
