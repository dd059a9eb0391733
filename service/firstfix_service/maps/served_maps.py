"""The published maps, the version of each map that answers queries, and the versions that one query needs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence, Set
from concurrent.futures import Future
from operator import attrgetter

from ..telemetry.metrics import Metrics
from .loaded_versions import Lease, LoadedVersions

_SERVED = attrgetter("served")


class ServedMaps:
    """Published maps and their serving versions, as of the last poll or a later query. Thread-safe.

    Args:
        load: returns a future of a lease of a version that is not in memory; None: the active version.
    """

    def __init__(
        self,
        loaded: LoadedVersions,
        load: Callable[[str, str | None], Future[Lease]],
        metrics: Metrics,
    ) -> None:
        self._loaded = loaded
        self._load = load
        self._metrics = metrics
        self._hits = metrics.cache_lookups.labels("hit")
        self._misses = metrics.cache_lookups.labels("miss")
        self._lock = threading.Lock()
        self._published: set[str] = set()  # maps with a version
        self._serving: dict[str, str] = {}  # map id -> version that answers when none is named
        self._behind: set[str] = set()  # maps whose active version was refused
        self._touched: set[str] = set()

    def __len__(self) -> int:
        with self._lock:
            return len(self._published)

    def __contains__(self, map_id: object) -> bool:
        """Whether a map is published, that is, has a version."""
        with self._lock:
            return map_id in self._published

    @property
    def ids(self) -> list[str]:
        """Ids of the published maps, sorted."""
        with self._lock:
            return sorted(self._published)

    @property
    def versions(self) -> dict[str, str]:
        """Serving versions by map id, of the maps that were queried or loaded so far."""
        with self._lock:
            return dict(self._serving)

    def version(self, map_id: str) -> str | None:
        """The serving version of a map, if there is one."""
        with self._lock:
            return self._serving.get(map_id)

    def lease(self, map_ids: Sequence[str], version: str | None = None) -> Future[Leases]:
        """The versions that answer a query about one map or several.

        The future is done at once if the versions are in memory. Otherwise a load runs in another thread, one
        load for all queries that need it.

        Args:
            map_ids: well-formed (``firstfix.ids``), and so is the version.
            version: or its first characters; None means the active version of each map.

        The future raises NotFound if there is no such map or version, InvalidOption if several versions begin
        so, VersionError if neither it nor an
        earlier active version can be served, and StoreError.
        """
        if len(map_ids) == 1:
            return _gathered([self._lease(map_ids[0], version)])
        self._loaded.begin_overcommit()
        gathered = _gathered([self._lease(map_id, version) for map_id in map_ids])
        gathered.add_done_callback(lambda _: self._loaded.end_overcommit())
        return gathered

    def lease_loaded(self, map_id: str, version: str | None = None) -> Leases | None:
        """The version of one map, if it is in memory: without the futures of ``lease``."""
        if not version:
            with self._lock:
                version = self._serving.get(map_id, "")
        lease = self._loaded.lease((map_id, version))
        if lease is None:
            return None
        self._metrics.late.add(self._hits.inc)
        return Leases([lease])

    def lease_some(self, map_ids: Sequence[str]) -> SomeLeases:
        """The active versions of those of the maps that can be served.

        The future raises the first error if no map can be served.
        """
        self._loaded.begin_overcommit()
        some = SomeLeases([self._lease(map_id, None) for map_id in map_ids])
        some.future.add_done_callback(lambda _: self._loaded.end_overcommit())
        return some

    def _lease(self, map_id: str, version: str | None) -> Future[Lease]:
        lease = self._loaded.lease((map_id, version or self.version(map_id) or ""))
        (self._misses if lease is None else self._hits).inc()
        if lease is None:
            return self._load(map_id, version)
        future: Future[Lease] = Future()
        future.set_result(lease)
        return future

    def is_behind(self, map_id: str) -> bool:
        """Whether an older version answers because the active one was refused."""
        with self._lock:
            return map_id in self._behind

    def add(self, map_ids: Set[str]) -> None:
        """Add published maps."""
        with self._lock:
            self._published |= map_ids
            self._touched |= map_ids

    def serve(self, map_id: str, version: str, *, is_active: bool) -> str | None:
        """Set the serving version of a map and return the one before."""
        with self._lock:
            before = self._serving.get(map_id)
            self._serving[map_id] = version
            self._published.add(map_id)
            self._touched.add(map_id)
            (self._behind.discard if is_active else self._behind.add)(map_id)
            self._metrics.maps_behind.set(len(self._behind))
        return before

    def forget(self, map_id: str) -> None:
        """Remove a map that has no active version any more."""
        with self._lock:
            self._published.discard(map_id)
            self._serving.pop(map_id, None)
            self._behind.discard(map_id)
            self._touched.add(map_id)
            self._metrics.maps_behind.set(len(self._behind))

    def touch(self, map_ids: Iterable[str]) -> None:
        """Marks maps whose public state may have changed."""
        with self._lock:
            self._touched.update(map_ids)

    def take_touched(self) -> set[str]:
        """The maps whose public state may have changed since the last call."""
        with self._lock:
            touched, self._touched = self._touched, set()
            return touched


class Leases:
    """The versions that one query needs."""

    def __init__(self, leases: Sequence[Lease]) -> None:
        self._leases = leases
        self.served = tuple(map(_SERVED, leases))

    def close(self) -> None:
        """Close all leases."""
        for lease in self._leases:
            lease.close()


class SomeLeases:
    """Leases of those of several maps that can be served. Thread-safe.

    Attributes:
        future: of the leases, done when all loads have ended.
    """

    def __init__(self, futures: Sequence[Future[Lease]]) -> None:
        self.future: Future[Leases] = Future()
        self._futures = futures
        self._lock = threading.Lock()
        self._left = len(futures)
        self._taken: set[Future[Lease]] | None = None
        for future in futures:
            future.add_done_callback(self._ended)

    def settle(self) -> None:
        """Goes on with the versions that are in memory now, if there are any. The others are given back."""
        with self._lock:
            if self._taken is not None:
                return
            there = [one for one in self._futures if one.done() and one.exception() is None]
            if not there and self._left:
                return
            self._taken = set(there)
        if there:
            self.future.set_result(Leases([one.result() for one in there]))
        else:
            error = self._futures[0].exception()
            assert error is not None
            self.future.set_exception(error)

    def _ended(self, future: Future[Lease]) -> None:
        with self._lock:
            self._left -= 1
            is_last, taken = not self._left, self._taken
        if taken is not None:
            if future not in taken and future.exception() is None:
                future.result().close()
        elif is_last:
            self.settle()


def _gathered(futures: Sequence[Future[Lease]]) -> Future[Leases]:
    """A future of all the leases. If one fails, it raises the first error after all have ended."""
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
