"""Comparison of this machine's clock with the store's: expiries and tokens are judged by the machine's."""

from __future__ import annotations

import time

import structlog

from firstfix.store.store import Store

from ..telemetry.metrics import Metrics
from ..thread_pools import MAINTENANCE
from ..thread_pools.background import PeriodicTask

_log = structlog.get_logger(__name__)
INTERVAL_S = 300.0
TOLERATED_S = 30.0


class ClockComparison:
    """Offset of the local clock from the store's, in a metric. A large one is also in the log, once."""

    def __init__(self, store: Store, metrics: Metrics) -> None:
        self._store = store
        self._metrics = metrics
        self._warned_s = 0.0  # the offset of the last warning; 0 after the clock was right again

    def compare(self) -> None:
        """Measure the offset.

        Raises:
            StoreUnavailable, StoreError: the store failed.
        """
        begin_s = time.time()
        store_s = self._store.now().timestamp()
        end_s = time.time()
        # the store's time is of some moment in between
        offset_s = min((begin_s - store_s, end_s - store_s), key=abs)
        if begin_s <= store_s <= end_s:
            offset_s = 0.0
        self._metrics.clock_offset.set(offset_s)
        if abs(offset_s) <= TOLERATED_S:
            if self._warned_s:
                _log.info("this machine's clock agrees with the store's again", offset_s=round(offset_s, 1))
            self._warned_s = 0.0
        elif abs(offset_s - self._warned_s) > TOLERATED_S:
            _log.warning("this machine's clock is not the store's", offset_s=round(offset_s, 1))
            self._warned_s = offset_s


def clock_comparison(store: Store, metrics: Metrics) -> PeriodicTask:
    """The task that compares the clocks. It writes to the store."""
    compare = MAINTENANCE.route(ClockComparison(store, metrics).compare)
    return PeriodicTask("compare the clocks", compare, INTERVAL_S)
