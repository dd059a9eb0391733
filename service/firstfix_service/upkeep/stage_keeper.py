"""Keeps the shared stages of builds from growing without end."""

from __future__ import annotations

import asyncio

import structlog

from firstfix.builds.shared_stages import collect_stages
from firstfix.errors import FirstfixError
from firstfix.store.store import Store

from ..lanes import UPKEEP
from ..settings import Settings

_log = structlog.get_logger(__name__)
PERIOD_S = 3600.0


async def keep_stages_within(settings: Settings, store: Store) -> None:
    """Every hour, until it is cancelled. Several processes may do it on one store."""
    older_than_s = settings.shared_stages_days * 86400.0
    while True:
        try:
            collected = await UPKEEP.run(
                collect_stages, store, older_than_s, max_bytes=settings.shared_stages_max_bytes
            )
        except FirstfixError as error:
            _log.warning("shared stages were not looked through", code=error.code, error=str(error))
        else:
            _log.info(
                "shared stages looked through",
                removed=len(collected.removed),
                removed_bytes=collected.removed_bytes,
                kept=collected.kept,
                kept_bytes=collected.kept_bytes,
            )
        await asyncio.sleep(PERIOD_S)
