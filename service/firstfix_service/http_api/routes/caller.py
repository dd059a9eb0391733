"""/caller and /sensors: who the caller is and what it may do, and for which sensors it may build."""

from __future__ import annotations

from functools import cache

from fastapi import APIRouter, Request, Response
from pydantic import TypeAdapter

from firstfix.access.permissions import Scope
from firstfix.sensor import preset, presets

from ...settings import Settings
from ..edge import CallerDep, needs
from ..schema.api_models import Caller, Sensor

router = APIRouter()


@router.get("/caller", tags=["operations"])
@needs(Scope.LOCALIZE)
async def get_caller(request: Request, caller: CallerDep) -> Caller:
    """The caller and its permissions: a page shows only what they allow."""
    settings: Settings = request.app.state.settings
    return Caller(
        name=caller.name,
        scopes=[scope.value for scope in Scope if caller.grant.allows(scope)],
        maps=list(caller.grant.maps),
        authentication=settings.auth == "on",
        read_only=settings.read_only,
    )


@router.get("/sensors", tags=["maps"], response_model=list[Sensor])
@needs(Scope.LOCALIZE)
async def get_sensors() -> Response:
    """The sensor presets, by name. A build's config names one, or changes some of its values."""
    return Response(sensors_json(), media_type="application/json")


@cache
def sensors_json() -> bytes:
    """Presets as JSON. Made once: it takes as long as ten other answers."""
    found = [Sensor.model_validate(preset(name).to_mapping()) for name in presets()]
    return TypeAdapter(list[Sensor]).dump_json(found)
