"""Reads the store little by little, to find damage before somebody needs the damaged object."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from datetime import timedelta

import structlog

from firstfix.errors import FirstfixError
from firstfix.store.store import Store
from firstfix.upkeep.verify import Verification, VerifyReport

from ..lanes import UPKEEP
from ..settings import Settings
from ..telemetry.metrics import Metrics

_log = structlog.get_logger(__name__)
FIRST_AFTER_S = 300.0  # a service that starts has other things to read
PERIOD_S = 3600.0  # from the end of a round to the next one
CALL_BYTES = 64 << 10  # that a call to the store counts as, at least: small records are not free


async def keep_verified(settings: Settings, store: Store, metrics: Metrics) -> None:
    """Until it is cancelled. Replicas may do it at the same time: a file that one of them found right the
    others pass over for ``verify_days``."""
    await asyncio.sleep(FIRST_AFTER_S)
    while True:
        try:
            await verify_once(settings, store, metrics)
        except FirstfixError as error:  # the next time
            _log.warning("the store was not looked through", code=error.code, error=str(error))
        except Exception:  # a defect here is no reason to stop for good
            _log.exception("the look through the store failed")
        await asyncio.sleep(PERIOD_S)


async def verify_once(settings: Settings, store: Store, metrics: Metrics) -> None:
    """One round through the store, at most ``verify_bytes_per_s`` fast.

    Raises:
        StoreUnavailable, StoreError: as the store.
    """
    verification = Verification(store, max_age=timedelta(days=settings.verify_days))
    steps, told = verification.steps(), _Told(metrics)
    while (seconds := await UPKEEP.run(_timed, steps)) is not None:
        metrics.verify_seconds.inc(seconds)
        read = told.tell(verification.report)
        await asyncio.sleep(max(read, CALL_BYTES) / settings.verify_bytes_per_s)
    told.tell(verification.report)
    report = verification.report
    metrics.damaged_objects.set(len(report.findings))
    _log.info(
        "the store was looked through",
        objects=report.objects,
        bytes=report.bytes,
        fresh=report.fresh,
        damaged=len(report.findings),
    )


class _Told:
    """Part of a growing report that the metrics and the log were told."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._objects = self._bytes = self._damaged = 0

    def tell(self, report: VerifyReport) -> int:
        """Tells the metrics and the log what is new. Returns its bytes."""
        for finding in report.findings[self._damaged :]:
            _log.error("damaged in the store", key=finding.key, problem=finding.problem)
        objects, damaged = report.objects - self._objects, len(report.findings) - self._damaged
        read = report.bytes - self._bytes
        self._metrics.verified_objects.labels("damaged").inc(damaged)
        self._metrics.verified_objects.labels("right").inc(max(0, objects - damaged))
        self._metrics.verify_bytes.inc(read)
        self._objects, self._bytes, self._damaged = report.objects, report.bytes, len(report.findings)
        return read


def _timed(steps: Iterator[int]) -> float | None:
    """Seconds that the next step took; None: there is none."""
    start = time.perf_counter()
    return None if next(steps, None) is None else time.perf_counter() - start
