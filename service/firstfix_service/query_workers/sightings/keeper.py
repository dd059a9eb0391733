"""Sightings of this replica: stored at intervals, and read together with those of other replicas."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Mapping
from datetime import datetime, timezone

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.sightings.record import MAX_ROWS, SightingsRecord
from firstfix.catalog.sightings.sightings import Sightings
from firstfix.engine.changes.tally import Tally
from firstfix.errors import FirstfixError, NotFound

from ...telemetry.metrics import Metrics
from ...thread_pools import MAINTENANCE
from ...thread_pools.background import PeriodicTask
from ..base import QueryWorkers

_log = structlog.get_logger(__name__)
FLUSH_INTERVAL_S = 300.0  # changes of a map take days to show; each flush is a put for each version


class SightingsKeeper:
    """Keeps what the query workers of this replica have counted. Thread-safe.

    Counts since the last ``flush`` are in memory. ``read`` includes them, but other replicas do not see them.
    """

    def __init__(self, catalog: Catalog, workers: QueryWorkers, metrics: Metrics) -> None:
        self._catalog = catalog
        self._workers = workers
        self._metrics = metrics
        self._stored = Sightings(catalog.store)
        self._lock = threading.Lock()
        self._pending: dict[tuple[str, str], Tally] = {}

    def read(self, map_id: str, version: str) -> SightingsRecord:
        """The sightings of a version: of the whole store, and what this replica has not put there yet.

        Raises:
            NotFound: the map has no such version, or it was retired.
            StoreError: the store failed.
        """
        folder = self._catalog.folder_of(map_id, version)
        self._collect()
        with self._lock:  # so that nothing moves to the store meanwhile, and counts twice
            own = self._pending.get((map_id, version))
            stored = self._stored.read(folder)
        now = datetime.now(timezone.utc)
        return stored if own is None else stored.plus([("", SightingsRecord.of(own, now))])

    def state(self, map_id: str, version: str) -> Hashable:
        """A mark of what ``read`` would tell: while the mark stays the same, so does that.

        Raises:
            NotFound, StoreError: as ``read``.
        """
        folder = self._catalog.folder_of(map_id, version)
        self._collect()
        with self._lock:
            own = self._pending.get((map_id, version))
            return self._stored.state(folder), 0 if own is None else own.sightings

    def flush(self) -> None:
        """Store the counts, and merge the parts in the store if there are many.

        What a failing store does not take is kept for the next time. Counts of retired versions are dropped.
        """
        self._collect()
        now: datetime | None = None
        with self._lock:
            waiting = list(self._pending.items())
        for key, _ in waiting:
            try:
                # The store's clock: a replica whose own is wrong would remove the days of all others.
                now = now or self._catalog.store.now()
                self._flush(*key, now)
            except NotFound:  # retired
                with self._lock:
                    self._pending.pop(key, None)
            except FirstfixError as error:
                self._metrics.sightings.labels("not_stored").inc()
                _log.warning(
                    "sightings could not be stored", map_id=key[0], code=error.code, error=str(error)
                )

    def _flush(self, map_id: str, version: str, now: datetime) -> None:
        folder = self._catalog.folder_of(map_id, version)
        with self._lock:
            tally = self._pending.get((map_id, version))
            if tally is None:
                return
            self._stored.put(folder, tally, now)
            del self._pending[(map_id, version)]
        self._stored.merge(folder, now)

    def _collect(self) -> None:
        """Take what the workers have counted."""
        for sighted in self._workers.take_sightings():
            self._count(sighted.results)
            with self._lock:
                for served, tally in sighted.tallies.items():
                    key = served.map_id, served.version
                    together = Tally.sum([self._pending.get(key, Tally()), tally])
                    if len(together) <= MAX_ROWS // 2:  # otherwise the store has failed for long
                        self._pending[key] = together

    def _count(self, results: Mapping[str, int]) -> None:
        for result, count in results.items():
            self._metrics.sightings.labels(result).inc(count)


def sightings_maintenance(keeper: SightingsKeeper) -> PeriodicTask:
    """The task that puts the sightings of this replica into the store."""
    return PeriodicTask(
        "store sightings", MAINTENANCE.route(keeper.flush), FLUSH_INTERVAL_S, FLUSH_INTERVAL_S
    )
