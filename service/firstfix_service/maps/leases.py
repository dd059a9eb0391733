"""The versions that one query needs, of which some may still be on their way."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import Future

from .loaded_versions import Lease


class Leases:
    """The versions that one query needs."""

    def __init__(self, leases: Sequence[Lease]) -> None:
        self._leases = leases
        self.served = tuple(lease.served for lease in leases)

    def close(self) -> None:
        for lease in self._leases:
            lease.close()


def together(futures: Sequence[Future[Lease]]) -> Future[Leases]:
    """All of them, or the first error when all have ended."""
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
