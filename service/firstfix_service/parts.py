"""What the routes share: one of each, made by ``create_app`` and started with it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from firstfix.caller_usage import CallerUsage
from firstfix.catalog import Catalog
from firstfix.georeferences import Georeferences
from firstfix.uploads import Uploads

from .access import Access
from .build_queue import BuildQueue
from .build_quota import BuildQuota
from .disk_space import DiskSpace
from .georeference_cache import GeoreferenceCache
from .health import Health
from .localize import LocalizeUseCase
from .map_cache import MapCache
from .metrics import Metrics
from .paced_body import Pace
from .places import Places
from .pool import QueryPool
from .request_body import BodyReader
from .settings import Settings
from .upload_quota import UploadQuota


@dataclass(frozen=True)
class Parts:
    """Attributes:
    builds: None when this process records builds and another one runs them.
    closing: set when the service begins to stop: what would go on for long ends then.
    """

    settings: Settings
    metrics: Metrics
    catalog: Catalog
    maps: MapCache
    pool: QueryPool
    use_case: LocalizeUseCase
    bodies: BodyReader
    builds: BuildQueue | None
    health: Health
    access: Access
    uploads: Uploads
    upload_quota: UploadQuota
    upload_streams: Places
    upload_pace: Pace
    build_quota: BuildQuota
    usage: CallerUsage
    disks: DiskSpace
    event_streams: Places
    georeferences: Georeferences
    georeference_cache: GeoreferenceCache
    closing: asyncio.Event


async def parts_of(request: Request) -> Parts:
    """
    Raises:
        FirstfixError: they are not there yet, see ``firstfix_service.start``.
    """
    parts: Parts = request.app.state.start.parts
    return parts


PartsDep = Annotated[Parts, Depends(parts_of)]
