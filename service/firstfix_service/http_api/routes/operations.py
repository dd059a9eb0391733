"""Routes for orchestrators and monitoring: liveness, readiness, metrics."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel

import firstfix
from firstfix.access.permissions import Scope
from firstfix.errors import Overloaded

from ...telemetry.metrics import Metrics
from ...telemetry.stall_watch import StallWatch
from ...thread_pools import METRICS
from ..edge import needs, public
from ..health import HealthCheck
from ..parts import part_of
from ..schema.api_models import Health, Readiness
from ..short_way import DirectRoute

router = APIRouter(tags=["operations"], route_class=DirectRoute)  # everybody may probe, and often


@router.get("/healthz", response_model=Health)
@public
async def healthz(request: Request) -> Response:
    """Liveness: the process answers, and no part of it stands still.

    It fails while zenoh does not come back, and for 20 s after the event loop stood still for 5 s or longer.
    """
    _check_well(request)
    return _json(Health(status="ok", version=firstfix.__version__))


@router.get("/readyz", response_model=Readiness)
@public
async def readyz(request: Request) -> Response:
    """Readiness: the catalog was read, and as many maps are loaded as fit.

    The service stays ready when the store fails later, because loaded maps go on answering. It stops being
    ready FIRSTFIX_DRAIN_S before it ends.
    """
    health = part_of(request, HealthCheck)
    _check_well(request)
    why_not = health.why_not_ready()
    if request.app.state.draining.is_set():
        why_not = "the service is about to stop"
    if why_not is not None:
        raise Overloaded(why_not)
    return _json(Readiness.model_validate({"status": "ready", **health.details()}))


@router.get("/metrics", include_in_schema=False)
@needs(Scope.METRICS)
async def metrics(request: Request) -> Response:
    """Metrics in Prometheus format, also before the service is ready."""
    counted: Metrics = request.app.state.metrics
    body, media_type = await METRICS.run(counted.exposition, request.headers.get("accept", ""))
    return Response(body, headers={"Content-Type": media_type, "Vary": "Accept"})


def _json(answer: BaseModel) -> Response:
    return Response(answer.model_dump_json(), media_type="application/json")


def _check_well(request: Request) -> None:
    """Check that no part of the process stands still.

    Raises:
        Overloaded: one does, or did so a moment ago.
    """
    watch: StallWatch = request.app.state.watch
    why = watch.why_unwell()
    if why is not None:
        raise Overloaded(why)
