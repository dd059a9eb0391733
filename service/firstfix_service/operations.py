"""What an orchestrator and a monitor ask: alive, ready, how much of what."""

from __future__ import annotations

from fastapi import APIRouter, Response

from firstfix.errors import Overloaded

from .api_models import Health, Readiness
from .metrics import MEDIA_TYPE
from .parts import PartsDep

router = APIRouter(tags=["operations"])


@router.get("/healthz")
async def healthz() -> Health:
    """The process answers."""
    return Health(status="ok")


@router.get("/readyz")
async def readyz(parts: PartsDep) -> Readiness:
    """Send queries here: the catalog was read and what fits is loaded. Stays so when the store fails
    later, as what is loaded goes on answering."""
    if not parts.maps.polled:
        raise Overloaded("the maps are being loaded")
    return Readiness(status="ready", maps=len(parts.maps.map_ids))


@router.get("/metrics", include_in_schema=False)
async def metrics(parts: PartsDep) -> Response:
    return Response(parts.metrics.exposition(), headers={"Content-Type": MEDIA_TYPE})
