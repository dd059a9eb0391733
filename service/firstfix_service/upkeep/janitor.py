"""Removes uploads and idempotency keys that nobody came back to, now and then."""

from __future__ import annotations

import asyncio

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError
from firstfix.upkeep.garbage import remove_abandoned

from ..lanes import UPKEEP

_log = structlog.get_logger(__name__)
PERIOD_S = 3600.0


async def keep_clean(catalog: Catalog) -> None:
    """Until it is cancelled. Replicas may do it at the same time: each removes what is still there."""
    while True:
        try:
            found = await UPKEEP.run(remove_abandoned, catalog)
            if found.count:
                _log.info("removed what was abandoned", objects=found.count)
        except FirstfixError as error:  # the next time
            _log.warning("cannot remove what was abandoned", code=error.code, error=str(error))
        await asyncio.sleep(PERIOD_S)
