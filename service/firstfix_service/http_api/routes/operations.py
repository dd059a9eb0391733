"""What an orchestrator and a monitor ask: alive, ready, how much of what."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

import firstfix
from firstfix.errors import Overloaded

from ...telemetry.metrics import Metrics
from ..dependencies import PartsDep
from ..schema.api_models import Health, Readiness

router = APIRouter(tags=["operations"])


@router.get("/healthz")
async def healthz() -> Health:
    """The process answers."""
    return Health(status="ok", version=firstfix.__version__)


@router.get("/readyz")
async def readyz(request: Request, parts: PartsDep) -> Readiness:
    """Send queries here: the catalog was read and what fits is loaded. Stays so when the store fails
    later, as what is loaded goes on answering; ends FIRSTFIX_DRAIN_S before the service does."""
    why_not = parts.health.why_not_ready()
    if request.app.state.draining.is_set():
        why_not = "the service is about to stop"
    if why_not is not None:
        raise Overloaded(why_not)
    return Readiness.model_validate({"status": "ready", **parts.health.details()})


@router.get("/metrics", include_in_schema=False)
async def metrics(request: Request) -> Response:
    """Also before the service is ready."""
    counted: Metrics = request.app.state.metrics
    body, media_type = counted.exposition(request.headers.get("accept", ""))
    return Response(body, headers={"Content-Type": media_type, "Vary": "Accept"})
