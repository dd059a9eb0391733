"""What the routes share: one of each, made by ``create_app`` and started with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from firstfix.catalog import Catalog

from .access import Access
from .build_queue import BuildQueue
from .health import Health
from .localize import LocalizeUseCase
from .map_cache import MapCache
from .metrics import Metrics
from .pool import QueryPool
from .request_body import BodyReader
from .settings import Settings


@dataclass(frozen=True)
class Parts:
    """Attributes:
    builds: None when this process records builds and another one runs them.
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


async def parts_of(request: Request) -> Parts:
    parts: Parts = request.app.state.parts
    return parts


PartsDep = Annotated[Parts, Depends(parts_of)]
