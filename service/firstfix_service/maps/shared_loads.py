"""Loads for queries, in threads of their own; queries that ask for the same version share one load."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from ..telemetry.request_scope import in_this_context
from .leases import Lease

LOADERS = 8  # loads at the same time: a slow one does not delay the others


class SharedLoads:
    """Loads that queries wait for. Thread-safe.

    Args:
        load: loads a version of a map; None means its active version.
    """

    def __init__(self, load: Callable[[str, str | None], Lease]) -> None:
        self._load = load
        self._lock = threading.Lock()
        self._waiting: dict[tuple[str, str | None], list[Future[Lease]]] = {}
        self._threads = ThreadPoolExecutor(LOADERS, thread_name_prefix="map-loader")

    def request(self, map_id: str, version: str | None) -> Future[Lease]:
        """Returns a future of a lease. The first request for a version begins the load."""
        future: Future[Lease] = Future()
        wanted = (map_id, version)
        with self._lock:
            waiting = self._waiting.setdefault(wanted, [])
            waiting.append(future)
            if len(waiting) == 1:
                self._threads.submit(in_this_context(self._run), wanted)
        return future

    def close(self) -> None:
        """Waits for the loads that have begun; the others are cancelled."""
        self._threads.shutdown(cancel_futures=True)

    def _run(self, wanted: tuple[str, str | None]) -> None:
        try:
            lease = self._load(*wanted)
        except BaseException as error:
            for future in self._take_waiting(wanted):
                future.set_exception(error)
            return
        for future in self._take_waiting(wanted):
            future.set_result(lease.renew())
        lease.close()

    def _take_waiting(self, wanted: tuple[str, str | None]) -> list[Future[Lease]]:
        with self._lock:
            return self._waiting.pop(wanted)
