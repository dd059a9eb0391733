"""Loads for queries, in threads of their own; queries that ask for the same version share one load."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field

from ..telemetry.request_scope import current_caller
from ..thread_pools import ThreadPool
from .loaded_versions import Lease

LOADERS = 8  # loads at the same time: a slow one does not delay the others
Wanted = tuple[str, str | None]  # a map and its version; None: the active one


@dataclass
class _SharedLoad:
    """One load.

    Attributes:
        waiting: for its lease.
        callers: in whose turns it may begin: whichever comes first.
    """

    waiting: list[Future[Lease]] = field(default_factory=list)
    callers: set[str] = field(default_factory=set)
    has_begun: bool = False


class SharedLoads:
    """Loads that queries wait for; callers take turns. Thread-safe.

    Args:
        load: loads a version of a map; None means its active version.
    """

    def __init__(self, load: Callable[[str, str | None], Lease]) -> None:
        self._load = load
        self._lock = threading.Lock()
        self._loads: dict[Wanted, _SharedLoad] = {}
        self._pool = ThreadPool("map-loader", LOADERS)

    def request(self, map_id: str, version: str | None) -> Future[Lease]:
        """Returns a future of a lease. The first caller whose turn comes begins the load."""
        future: Future[Lease] = Future()
        wanted, caller = (map_id, version), current_caller()
        with self._lock:
            shared = self._loads.setdefault(wanted, _SharedLoad())
            shared.waiting.append(future)
            is_queued = shared.has_begun or caller in shared.callers
            shared.callers.add(caller)
        if not is_queued:
            self._pool.submit(caller, self._run, wanted, shared)
        return future

    def close(self) -> None:
        """Waits for the loads that have begun; the others are cancelled."""
        self._pool.close()

    def _run(self, wanted: Wanted, shared: _SharedLoad) -> None:
        with self._lock:
            if shared.has_begun:  # in the turn of another caller
                return
            shared.has_begun = True
        try:
            lease = self._load(*wanted)
        except BaseException as error:
            for future in self._take_waiting(wanted):
                future.set_exception(error)
            return
        for future in self._take_waiting(wanted):
            future.set_result(lease.renew())
        lease.close()

    def _take_waiting(self, wanted: Wanted) -> list[Future[Lease]]:
        with self._lock:
            return self._loads.pop(wanted).waiting
