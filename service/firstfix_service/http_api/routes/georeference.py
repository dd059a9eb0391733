"""/maps/{map_id}/georeference: where a map lies on the Earth."""

from __future__ import annotations

from fastapi import APIRouter, Request

from firstfix.access.permissions import Scope
from firstfix.catalog.geopose import Georeference
from firstfix.errors import InvalidOption, NotFound

from ...thread_pools import CHANGES, READS
from ..bodies.json_body import read_model
from ..edge import needs
from ..parts import MapParts, MapPartsDep
from ..schema.api_models import GeoreferenceBody, GeoreferenceRecord
from ..schema.bodies import json_body
from ..schema.parameters import MapId

router = APIRouter(prefix="/maps/{map_id}/georeference", tags=["georeference"])


@router.put("", openapi_extra=json_body(GeoreferenceBody))
@needs(Scope.BUILD, "change")
async def put_georeference(map_id: MapId, request: Request, parts: MapPartsDep) -> GeoreferenceRecord:
    """Set where the map lies on the Earth, for all its versions.

    This replica uses it at once, other replicas within seconds.
    """
    body = await read_model(request, GeoreferenceBody)
    georeference = _georeference(body)
    await CHANGES.run(_set, parts, map_id, georeference)
    return _record(map_id, georeference)


@router.get("")
@needs(Scope.LOCALIZE)
@READS.route
def get_georeference(map_id: MapId, parts: MapPartsDep) -> GeoreferenceRecord:
    """The map's place on the Earth; 404 if it was never set."""
    georeference = parts.georeferences.get(map_id)
    if georeference is None:
        raise NotFound(f"map {map_id} has no georeference")
    return _record(map_id, georeference)


@router.delete("", status_code=204)
@needs(Scope.BUILD, "change")
@CHANGES.route
def delete_georeference(map_id: MapId, parts: MapPartsDep) -> None:
    """Remove the georeference."""
    if parts.georeferences.get(map_id) is None:
        raise NotFound(f"map {map_id} has no georeference")
    _set(parts, map_id, None)


def _georeference(body: GeoreferenceBody) -> Georeference:
    if (body.x_axis_deg is None) == (body.quaternion is None):
        raise InvalidOption("give either x_axis_deg or quaternion")
    where = (body.latitude_deg, body.longitude_deg, body.height_m)
    ax, ay, az = body.anchor_m
    if body.quaternion is None:
        return Georeference.with_heading(*where, body.x_axis_deg or 0.0, (ax, ay, az))
    x, y, z, w = body.quaternion
    return Georeference(*where, (x, y, z, w), (ax, ay, az))


def _set(parts: MapParts, map_id: str, georeference: Georeference | None) -> None:
    if not parts.catalog.state(map_id).exists:
        raise NotFound.of_map(map_id)
    parts.georeferences.set(map_id, georeference)
    parts.georeference_cache.forget(map_id)


def _record(map_id: str, georeference: Georeference) -> GeoreferenceRecord:
    values = {**georeference.to_mapping(), "x_axis_deg": georeference.x_axis_deg}
    return GeoreferenceRecord.model_validate({"map_id": map_id, **values})
