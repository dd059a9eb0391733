"""Leases of loaded versions: a leased version is neither unloaded nor removed from the disk."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future

from ..query_workers.query import ServedVersion


class Lease:
    """A version that stays in memory and on the disk until the lease is closed. Close it once.

    Attributes:
        renew: returns another lease of the same version, for another user.
    """

    def __init__(self, served: ServedVersion, close: Callable[[], None], renew: Callable[[], Lease]) -> None:
        self.served = served
        self.close = close
        self.renew = renew


class Leases:
    """The versions that one query needs."""

    def __init__(self, leases: Sequence[Lease]) -> None:
        self._leases = leases
        self.served = tuple(lease.served for lease in leases)

    def close(self) -> None:
        """Closes all leases."""
        for lease in self._leases:
            lease.close()


def gather_leases(futures: Sequence[Future[Lease]]) -> Future[Leases]:
    """Returns a future of all the leases. If one fails, it raises the first error after all have ended."""
    gathered: Future[Leases] = Future()
    left = len(futures)
    lock = threading.Lock()

    def ended(_: Future[Lease]) -> None:
        nonlocal left
        with lock:
            left -= 1
            if left:
                return
        errors = [error for future in futures if (error := future.exception()) is not None]
        if not errors:
            gathered.set_result(Leases([future.result() for future in futures]))
            return
        for future in futures:
            if future.exception() is None:
                future.result().close()
        gathered.set_exception(errors[0])

    for future in futures:
        future.add_done_callback(ended)
    return gathered
