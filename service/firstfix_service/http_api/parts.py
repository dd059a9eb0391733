"""Parts of the running service that routes ask for, by room. ``compose`` makes one of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Request

from firstfix.builds.callers import CallerUsage
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.store.store import Store

from ..builds.queue import BuildQueue
from ..builds.quota import BuildQuota
from ..limits.concurrency_limit import ConcurrencyLimit
from ..limits.disk_space import DiskSpace
from ..localize.use_case import LocalizeUseCase
from ..maps.georeference_cache import GeoreferenceCache
from ..maps.map_cache import MapCache
from ..query_workers.sightings.keeper import SightingsKeeper
from ..telemetry.metrics import Metrics
from .bodies.request_body import BodyReader, Pace
from .bodies.uploads import UploadQuota
from .encoded_changes import EncodedChanges
from .made_once import MadeOnce

Part = TypeVar("Part")
Parts = Mapping[type, Any]  # by their types


@dataclass(frozen=True)
class LocalizeParts:
    """Parts for scans."""

    use_case: LocalizeUseCase
    bodies: BodyReader
    maps: MapCache
    georeference_cache: GeoreferenceCache
    metrics: Metrics


@dataclass(frozen=True)
class MapParts:
    """Parts for maps and their versions."""

    catalog: Catalog
    maps: MapCache
    georeferences: Georeferences
    georeference_cache: GeoreferenceCache
    sightings: SightingsKeeper
    changes: MadeOnce[EncodedChanges]


@dataclass(frozen=True)
class UploadParts:
    """Parts for files that arrive.

    Attributes:
        folder: for those of forms.
        max_bytes: of one file, and of one form.
        source_urls: prefixes of the URLs that may be named instead of a file.
    """

    store: Store
    uploads: Uploads
    quota: UploadQuota
    streams: ConcurrencyLimit
    pace: Pace
    disks: DiskSpace
    folder: Path
    max_bytes: int
    source_urls: tuple[str, ...]


@dataclass(frozen=True)
class BuildParts:
    """Parts for builds.

    Attributes:
        queue: None where this process records builds and another one runs them.
    """

    catalog: Catalog
    queue: BuildQueue | None
    quota: BuildQuota
    usage: CallerUsage


def part_of(request: Request, kind: type[Part]) -> Part:
    """A part of the service that answers a request.

    Raises:
        FirstfixError: the service has not started yet, see ``firstfix_service.startup.retry``.
    """
    found: Part = request.scope["app"].state.start.parts[kind]
    return found


def part(kind: type[Part]) -> Any:
    """The dependency of a route on a part."""

    async def find(request: Request) -> Part:
        return part_of(request, kind)

    return Depends(find)


MapPartsDep = Annotated[MapParts, part(MapParts)]
UploadPartsDep = Annotated[UploadParts, part(UploadParts)]
BuildPartsDep = Annotated[BuildParts, part(BuildParts)]
LocalizePartsDep = Annotated[LocalizeParts, part(LocalizeParts)]
CatalogDep = Annotated[Catalog, part(Catalog)]
RecordedQueriesDep = Annotated[RecordedQueries, part(RecordedQueries)]
