"""Parts of the service that the routes share. ``create_app`` makes one of each."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from firstfix.builds.caller_usage import CallerUsage
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.query_samples import QuerySamples
from firstfix.catalog.uploads.uploads import Uploads

from ..auth.authenticate import Authenticator
from ..builds.queue import BuildQueue
from ..builds.quota import BuildQuota
from ..localize.query_gate import QueryGate
from ..localize.use_case import LocalizeUseCase, RecentAnswers
from ..maps.georeference_cache import GeoreferenceCache
from ..maps.map_cache import MapCache
from ..query_workers.sightings.keeper import SightingsKeeper
from ..settings import Settings
from ..telemetry.metrics import Metrics
from .bodies.disk_space import DiskSpace
from .bodies.paced_body import Pace
from .bodies.request_body import BodyReader
from .bodies.upload_quota import UploadQuota
from .concurrency_limit import ConcurrencyLimit
from .health import Health


@dataclass(frozen=True)
class Parts:
    """Parts of a running service.

    Attributes:
        builds: None where this process records builds and another one runs them.
        closing: set when the service begins to stop. Streams of events end then.
    """

    settings: Settings
    metrics: Metrics
    catalog: Catalog
    maps: MapCache
    gate: QueryGate
    use_case: LocalizeUseCase
    bodies: BodyReader
    builds: BuildQueue | None
    health: Health
    authenticator: Authenticator
    uploads: Uploads
    upload_quota: UploadQuota
    upload_streams: ConcurrencyLimit
    upload_pace: Pace
    build_quota: BuildQuota
    usage: CallerUsage
    disks: DiskSpace
    event_streams: ConcurrencyLimit
    overlays: ConcurrencyLimit
    georeferences: Georeferences
    georeference_cache: GeoreferenceCache
    sightings: SightingsKeeper
    samples: QuerySamples
    recent: RecentAnswers
    closing: asyncio.Event


async def parts_of(request: Request) -> Parts:
    """Returns the parts of the service that answers a request.

    Raises:
        FirstfixError: the service has not started yet, see ``firstfix_service.startup.retry``.
    """
    parts: Parts = request.app.state.start.parts
    return parts


PartsDep = Annotated[Parts, Depends(parts_of)]
