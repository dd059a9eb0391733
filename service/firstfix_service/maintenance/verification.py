"""Periodic verification of the store: reads it slowly, to find damage before the damaged object is needed."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from datetime import timedelta

import structlog

from firstfix.maintenance.verify import Verification, VerifyReport
from firstfix.store.store import Store

from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..thread_pools import MAINTENANCE
from ..thread_pools.background import PeriodicTask

_log = structlog.get_logger(__name__)
FIRST_AFTER_S = 300.0  # a service that has just started reads other things first
INTERVAL_S = 3600.0  # from the end of a pass to the next pass
VERIFY_DAYS = 30.0  # a store charges for reads, and disks rot in years
CALL_BYTES = 64 << 10  # each call to the store counts as so many bytes at least: small records are not free


def store_verification(settings: Settings, store: Store, metrics: Metrics) -> PeriodicTask:
    """The task that verifies the store.

    Replicas may run it at the same time: a file that one of them found good is skipped by all for
    ``VERIFY_DAYS``.
    """
    return PeriodicTask(
        "verify the store", lambda: verify_once(settings, store, metrics), INTERVAL_S, FIRST_AFTER_S
    )


async def verify_once(settings: Settings, store: Store, metrics: Metrics) -> None:
    """Read the whole store once, at ``verify_bytes_per_s`` or slower.

    Raises:
        StoreUnavailable, StoreError: the store failed.
    """
    verification = Verification(store, max_age=timedelta(days=VERIFY_DAYS))
    steps, progress = verification.steps(), _Progress(metrics)
    while (seconds := await MAINTENANCE.run(_timed_step, steps)) is not None:
        metrics.verify_seconds.inc(seconds)
        read_bytes = progress.update(verification.report)
        await asyncio.sleep(max(read_bytes, CALL_BYTES) / settings.verify_bytes_per_s)
    progress.update(verification.report)
    report = verification.report
    metrics.damaged_objects.set(len(report.findings))
    _log.info(
        "verified the store",
        objects=report.objects,
        bytes=report.bytes,
        fresh=report.fresh,
        damaged=len(report.findings),
    )


class _Progress:
    """Copies a growing report to the metrics and the log."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._objects = self._bytes = self._damaged = 0

    def update(self, report: VerifyReport) -> int:
        """Record what is new in the report. Returns the number of new bytes."""
        for finding in report.findings[self._damaged :]:
            _log.error("damaged object in the store", key=finding.key, problem=finding.problem)
        objects, damaged = report.objects - self._objects, len(report.findings) - self._damaged
        read_bytes = report.bytes - self._bytes
        self._metrics.verified_objects.labels("damaged").inc(damaged)
        self._metrics.verified_objects.labels("right").inc(max(0, objects - damaged))
        self._metrics.verify_bytes.inc(read_bytes)
        self._objects, self._bytes, self._damaged = report.objects, report.bytes, len(report.findings)
        return read_bytes


def _timed_step(steps: Iterator[int]) -> float | None:
    """Seconds that the next step took; None at the end."""
    start = time.perf_counter()
    return None if next(steps, None) is None else time.perf_counter() - start
