"""The versions in memory, within limits: in the order of ``leaving_order``, never one that a query uses."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import structlog

from firstfix.catalog.versions.cache import HeldFolder

from ..query_workers.base import QueryWorkers
from ..query_workers.query import ServedVersion
from ..telemetry.metrics import Metrics
from .eviction_order import Key, LeavingOrder

_log = structlog.get_logger(__name__)
ROOM_WITHIN_S = 30.0  # without anything having gone meanwhile: then the limit is passed rather than wait on


@dataclass(frozen=True)
class VersionFiles:
    """A version on this machine.

    Attributes:
        hold: keeps a fetched folder on the disk; None for one in a file store.
    """

    served: ServedVersion
    file_bytes: int
    hold: HeldFolder | None

    @property
    def key(self) -> Key:
        return self.served.map_id, self.served.version


@dataclass(eq=False)
class _Resident:
    """Attributes:
    bytes: of its files, and of what the workers hold besides.
    leases: queries that use it.
    leaving: nobody gets it any more.
    """

    files: VersionFiles
    bytes: int
    leases: int = 0
    leaving: bool = False


class Lease:
    """A version that stays in memory, and on the disk, until it is closed. Close it once.

    Attributes:
        again: another lease of it, for somebody else.
    """

    def __init__(self, served: ServedVersion, close: Callable[[], None], again: Callable[[], Lease]) -> None:
        self.served = served
        self.close = close
        self.again = again


class ResidentVersions:
    """Thread-safe. The limits hold for what is in memory, what is on its way in and what is on its way out.

    Args:
        stays: whether the first version must not be put out for the second.
        keeps: whether a version is only put out when no other one can be.
        left: called for each one that nobody gets any more.
    """

    def __init__(
        self,
        workers: QueryWorkers,
        metrics: Metrics,
        *,
        max_versions: int,
        max_bytes: int,
        stays: Callable[[Key, Key], bool],
        keeps: Callable[[Key], bool],
        left: Callable[[Key], None],
    ) -> None:
        self._workers = workers
        self._metrics = metrics
        self._max_versions, self._max_bytes = max_versions, max_bytes
        self._stays = stays
        self._left = left
        self._changed = threading.Condition()
        self._residents: LeavingOrder[_Resident] = LeavingOrder(keeps)
        self._leaving: set[_Resident] = set()
        self._leaving_bytes = 0
        self._coming: dict[Key, int] = {}  # bytes of those being loaded
        self._coming_bytes = 0
        self._line: deque[Key] = deque()  # of loads that wait for room
        self._hurries = 0
        self._dropper = ThreadPoolExecutor(1, thread_name_prefix="map-dropper")

    def has_room(self, versions: int, size: int, *, kept: bool) -> bool:
        """For so many more versions of so many bytes together, without any other having to go.

        Args:
            kept: they are kept: those that are not may go for them.
        """
        with self._changed:
            taken, taken_bytes = self._taken()
            if kept:
                taken -= len(self._residents) - self._residents.kept
                taken_bytes -= self._residents.bytes - self._residents.kept_bytes
            return taken + versions <= self._max_versions and taken_bytes + size <= self._max_bytes

    @property
    def kept(self) -> int:
        """Versions in memory that are kept."""
        with self._changed:
            return self._residents.kept

    def sort_again(self) -> None:
        """After what is kept has changed."""
        with self._changed:
            self._residents.sort_again()

    def __contains__(self, key: Key) -> bool:
        with self._changed:
            return key in self._residents

    def lease(self, key: Key) -> Lease | None:
        """None: it is not in memory."""
        with self._changed:
            resident = self._residents.use(key)
            return None if resident is None else self._lease(resident)

    def load(self, files: VersionFiles) -> Lease:
        """Loads a version that is not in memory; one thread for each.

        Raises:
            VersionError: as ``QueryWorkers.load``.
        """
        key = files.key
        with self._changed:
            self._wait_for_room(key, files.file_bytes)
            self._coming[key] = files.file_bytes
            self._coming_bytes += files.file_bytes
        try:
            private = self._workers.load(files.served)
        except BaseException:
            with self._changed:
                self._coming_bytes -= self._coming.pop(key)
                self._changed.notify_all()
            raise
        with self._changed:
            self._coming_bytes -= self._coming.pop(key)
            resident = _Resident(files, files.file_bytes + private)
            self._residents.add(key, resident)
            lease = self._lease(resident)
            self._bid_go_for(key)  # it may take more than its files
            self._changed.notify_all()
            self._show()
        return lease

    def succeed(self, key: Key, before: Key | None) -> None:
        """This version serves now and the one before need not: what is over the limit goes."""
        with self._changed:
            for one in (before, key):
                if one is not None:
                    self._residents.use(one)  # which of them is kept has changed
            self._bid_go_for(key)
            self._show()

    def begin_hurry(self) -> None:
        """While a query gathers several versions the limit is passed: the query may itself hold what would
        have to go for the next of them."""
        with self._changed:
            self._hurries += 1
            self._changed.notify_all()

    def end_hurry(self) -> None:
        with self._changed:
            self._hurries -= 1

    def close(self) -> None:
        self._dropper.shutdown()

    def _lease(self, resident: _Resident) -> Lease:
        resident.leases += 1
        return Lease(
            resident.files.served, lambda: self._give_back(resident), lambda: self._lease_again(resident)
        )

    def _lease_again(self, resident: _Resident) -> Lease:
        with self._changed:
            return self._lease(resident)

    def _give_back(self, resident: _Resident) -> None:
        with self._changed:
            resident.leases -= 1
            if resident.leaving and not resident.leases:
                self._dropper.submit(self._drop, resident)

    def _wait_for_room(self, key: Key, need: int) -> None:
        """Under the lock. In the order of asking; begins anyway when there is nothing left to wait for."""
        self._line.append(key)
        try:
            while True:
                if self._line[0] == key:
                    self._bid_go_for(key, need)
                    versions, size = self._taken()
                    fits = versions + 1 <= self._max_versions and size + need <= self._max_bytes
                    if fits or not (self._leaving or self._coming):
                        return
                if self._hurries:
                    return
                if not self._changed.wait(ROOM_WITHIN_S):
                    _log.warning("versions that are still used pass the cache's limit", map_id=key[0])
                    return
        finally:
            self._line.remove(key)
            self._changed.notify_all()

    def _bid_go_for(self, key: Key, need: int | None = None) -> None:
        """Under the lock. The first to leave go, as soon as no query uses them, until the rest is within the
        limits, and so is one more of ``need`` bytes."""
        more = need is not None
        while (
            len(self._residents) + len(self._coming) + more > self._max_versions
            or self._residents.bytes + self._coming_bytes + (need or 0) > self._max_bytes
        ):
            candidates = (one for one in self._residents if one != key and not self._stays(one, key))
            candidate = next(candidates, None)
            if candidate is None:
                return
            resident = self._residents.pop(candidate)
            self._left(candidate)
            resident.leaving = True
            self._leaving.add(resident)
            self._leaving_bytes += resident.bytes
            if not resident.leases:
                self._dropper.submit(self._drop, resident)

    def _drop(self, resident: _Resident) -> None:
        served = resident.files.served
        try:
            self._workers.drop(served)
        finally:
            if resident.files.hold is not None:
                resident.files.hold.close()
            with self._changed:
                self._leaving.discard(resident)
                self._leaving_bytes -= resident.bytes
                self._changed.notify_all()
        self._metrics.version_evictions.inc()
        _log.info("version put out", map_id=served.map_id, version=served.version)

    def _taken(self) -> tuple[int, int]:
        """Versions and bytes, of what comes and goes too."""
        versions = len(self._residents) + len(self._coming) + len(self._leaving)
        return versions, self._residents.bytes + self._coming_bytes + self._leaving_bytes

    def _show(self) -> None:
        self._metrics.versions_loaded.set(len(self._residents))
        self._metrics.version_bytes.set(self._residents.bytes)
