"""What an orchestrator and a monitor ask: alive, ready, how much of what."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response

from firstfix.errors import Overloaded

from .metrics import MEDIA_TYPE, Metrics
from .parts import PartsDep

router = APIRouter(tags=["operations"])


@router.get("/healthz")
async def healthz() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok"}


@router.get("/readyz")
async def readyz(parts: PartsDep) -> dict[str, Any]:
    """Send queries here: the store answered, the catalog was read and what fits is loaded. Stays so when
    the store fails later, as what is loaded goes on answering."""
    if not parts.maps.polled:
        raise Overloaded("the maps are being loaded")
    return {"status": "ready", "maps": len(parts.maps.map_ids)}


@router.get("/metrics", include_in_schema=False)
async def metrics(request: Request) -> Response:
    """Also before the service is ready."""
    counted: Metrics = request.app.state.metrics
    return Response(counted.exposition(), headers={"Content-Type": MEDIA_TYPE})
