"""Warm-up of a version before it is served."""

from __future__ import annotations

import time

import structlog

from ..query_workers.base import QueryWorkers
from ..query_workers.query import ServedVersion
from ..telemetry.metrics import Metrics

_log = structlog.get_logger(__name__)


def warm_up(workers: QueryWorkers, served: ServedVersion, metrics: Metrics) -> None:
    """Ask a loaded version about scans of its own map, in all workers. Blocks, and never fails.

    A version that cannot be warmed up is served all the same: its queries say what is wrong.
    """
    start = time.perf_counter()
    try:
        queries = workers.warm_up(served)
    except Exception as error:
        metrics.version_warm_ups.labels("failed").inc()
        _log.warning("version not warmed up", map_id=served.map_id, version=served.version, error=repr(error))
        return
    if queries:  # none where every worker is warm already
        metrics.version_warm_ups.labels("ok").inc()
        seconds = round(time.perf_counter() - start, 3)
        _log.info(
            "version warmed up",
            map_id=served.map_id,
            version=served.version,
            queries=queries,
            seconds=seconds,
        )
