"""Patches without a person: once a day for each map whose config allows them, if it seems to have changed."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.maintenance.patch import request_due_patches

from ..thread_pools import MAINTENANCE
from ..thread_pools.background import PeriodicTask

_log = structlog.get_logger(__name__)
INTERVAL_S = 1200.0  # a map has its hour, and several replicas record one build in it


def map_patches(catalog: Catalog, submit: Callable[[str], Awaitable[None]] | None) -> PeriodicTask:
    """The task that records the patches that are due.

    Args:
        submit: tells the build queue of a build on record; None: it finds them itself.
    """

    def due() -> list[str]:
        return request_due_patches(catalog, catalog.store.now())

    async def request() -> None:
        for build_id in await MAINTENANCE.run(due):
            _log.info("a patch of a map is due", build_id=build_id)
            if submit is not None:
                await submit(build_id)

    return PeriodicTask("request patches of maps", request, INTERVAL_S, first_after_s=INTERVAL_S)
