"""Periodic removal of objects from the store that nobody uses any more.

Several replicas may run these tasks on one store at the same time: each removes what is still there.
"""

from __future__ import annotations

import structlog

from firstfix.builds.shared_stages import collect_stages
from firstfix.catalog.catalog import Catalog
from firstfix.maintenance.garbage import remove_abandoned
from firstfix.store.store import Store

from ..settings import Settings
from ..thread_pools import MAINTENANCE
from ..thread_pools.background import PeriodicTask

_log = structlog.get_logger(__name__)
INTERVAL_S = 3600.0
MAX_STAGE_AGE_S = 7 * 86400.0  # a build that is tried again, or a map that is built again, is so within days


def abandoned_objects_removal(catalog: Catalog) -> PeriodicTask:
    """The task that removes expired uploads and idempotency keys."""

    async def remove() -> None:
        removed = await MAINTENANCE.run(remove_abandoned, catalog)
        if removed.count:
            _log.info("removed abandoned objects", objects=removed.count)

    return PeriodicTask("remove abandoned objects", remove, INTERVAL_S)


def shared_stages_removal(settings: Settings, store: Store) -> PeriodicTask:
    """The task that keeps the shared stages of builds within their age and size limits."""

    async def remove() -> None:
        collected = await MAINTENANCE.run(
            collect_stages,
            store,
            MAX_STAGE_AGE_S,
            max_bytes=settings.shared_stages_bytes,
        )
        _log.info(
            "checked the shared stages",
            removed=len(collected.removed),
            removed_bytes=collected.removed_bytes,
            kept=collected.kept,
            kept_bytes=collected.kept_bytes,
        )

    return PeriodicTask("remove shared stages", remove, INTERVAL_S)
