"""What an orchestrator and a monitor ask: alive, ready, how much of what."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response

import firstfix
from firstfix.errors import Overloaded

from .parts import PartsDep

router = APIRouter(tags=["operations"])


@router.get("/healthz")
async def healthz() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok", "version": firstfix.__version__}


@router.get("/readyz")
async def readyz(parts: PartsDep) -> dict[str, Any]:
    """Send queries here: the catalog was read and what fits is loaded. Stays so when the store fails
    later, as what is loaded goes on answering."""
    why_not = parts.health.why_not_ready()
    if why_not is not None:
        raise Overloaded(why_not)
    return {"status": "ready", "maps": len(parts.maps.map_ids), **parts.health.details()}


@router.get("/metrics", include_in_schema=False)
async def metrics(request: Request, parts: PartsDep) -> Response:
    body, media_type = parts.metrics.exposition(request.headers.get("accept", ""))
    return Response(body, headers={"Content-Type": media_type, "Vary": "Accept"})
