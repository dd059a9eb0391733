"""The service from outside during the drill: its memory, and how late its event loop answers /healthz."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import httpx

from .processes import resident_bytes, tree_of

POLL_S = 0.05
MEMORY_S = 0.5
GIVEN_UP_S = 30.0


class Watch:
    """Samples until the end of a block.

    Args:
        pid: returns the service's process id, which changes when it is started anew.
        often: called at each look at the memory.
    """

    def __init__(self, url: str, pid: Callable[[], int], often: Callable[[], None]) -> None:
        self._url, self._pid, self._often = url, pid, often
        self._lags: list[tuple[float, float]] = []  # when asked, seconds
        self._asked: float | None = None
        self._memory: list[tuple[float, int]] = []
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._poll_health, self._see_memory)
        ]

    def __enter__(self) -> Watch:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def worst_lag_s(self, begin: float, end: float) -> float:
        """Longest time of an answer of /healthz that was asked for then."""
        asked = self._asked
        open_s = [time.monotonic() - asked] if asked is not None and begin <= asked < end else []
        return max([lag for at, lag in list(self._lags) if begin <= at < end] + open_s, default=0.0)

    def most_bytes(self, begin: float, end: float) -> int:
        """Largest memory of the service and its children then."""
        return max((size for at, size in list(self._memory) if begin <= at < end), default=0)

    def _poll_health(self) -> None:
        http = httpx.Client(base_url=self._url, timeout=GIVEN_UP_S)
        while not self._stop.wait(POLL_S):
            self._asked = asked = time.monotonic()
            try:
                http.get("/healthz")
            except httpx.TimeoutException:
                pass
            except httpx.TransportError:  # it is being started
                self._asked = None
                continue
            self._lags.append((asked, time.monotonic() - asked))
            self._asked = None
        http.close()

    def _see_memory(self) -> None:
        while not self._stop.wait(MEMORY_S):
            self._often()
            self._memory.append((time.monotonic(), resident_bytes(tree_of(self._pid()))))
