"""POST /maps/{map_id}/versions/{version}/overlay: what the map says about each point of a scan at a pose."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from firstfix.access.permissions import Scope
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.version_prefix import check_prefix
from firstfix.errors import InvalidOption
from firstfix.ids import check_map_id
from firstfix.scan_formats import MEDIA_TYPES
from firstfix_service.http_api.edge import CallerDep, needs
from firstfix_service.http_api.parts import LocalizePartsDep
from firstfix_service.http_api.schema.bodies import binary_answer, binary_body
from firstfix_service.http_api.schema.parameters import MapId, Version

from .laid_scan import laid_over
from .look import look_at

router = APIRouter(prefix="/maps/{map_id}/versions/{version}/overlay", tags=["localize"])


@router.post(
    "",
    response_class=Response,
    responses=binary_answer("application/octet-stream"),
    openapi_extra=binary_body(MEDIA_TYPES),
)
@needs(Scope.LOCALIZE, "localize", has_queue=True)
async def post_overlay(
    map_id: MapId,
    version: Version,
    request: Request,
    parts: LocalizePartsDep,
    caller: CallerDep,
    T_map_sensor: Annotated[str, Query(max_length=400, description="pose, `x,y,z,qx,qy,qz,qw`")],
) -> Response:
    """The points of a scan at a pose, 16 bytes each: x, y, z as float32, then what the map says as uint32.

    Little-endian; metres from the sensor, along the map's axes. 0: the point lies on a mapped surface. 1: its
    ray passes through one. 2: nothing in the map explains it. Of a large scan a part, by chance.
    """
    check_map_id(map_id)
    check_prefix(version)
    pose = LocalizeOptions.from_strings({"T_base_sensor": T_map_sensor}).T_base_sensor
    if pose is None:
        raise InvalidOption("T_map_sensor is 7 numbers separated by commas")
    laid = await look_at(request, parts, caller, partial(laid_over, pose), map_id, version)
    return Response(laid, media_type="application/octet-stream", headers={"Cache-Control": "no-store"})
