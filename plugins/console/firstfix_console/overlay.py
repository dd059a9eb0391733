"""POST /maps/{map_id}/versions/{version}/overlay: what the map says about each point of a scan at a pose."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query, Request, Response

from firstfix.access.permissions import Scope
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.version_prefix import check_prefix
from firstfix.engine.changes.overlay import OverlayMap
from firstfix.errors import InvalidOption
from firstfix.formats.point_cloud import Body
from firstfix.ids import check_map_id
from firstfix.scan_formats import MEDIA_TYPES
from firstfix.transform import Matrix
from firstfix_service.http_api.edge import CallerDep, needs
from firstfix_service.http_api.parts import LocalizePartsDep
from firstfix_service.http_api.schema.bodies import binary_answer, binary_body
from firstfix_service.http_api.schema.parameters import MapId, Version
from firstfix_service.query_workers.query import BodyFormat
from firstfix_service.thread_pools import LOOKS

router = APIRouter(prefix="/maps/{map_id}/versions/{version}/overlay", tags=["localize"])
POINT = np.dtype([("at", "<f4", 3), ("kind", "<u4")])


@router.post(
    "",
    response_class=Response,
    responses=binary_answer("application/octet-stream"),
    openapi_extra=binary_body(MEDIA_TYPES),
)
@needs(Scope.LOCALIZE, "localize")
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
    headers = request.headers
    body_format = BodyFormat.of(headers.get("content-type", ""), headers.get("content-encoding"))
    with parts.overlays.request(caller.name):
        body = await parts.bodies.read(request, caller.name)
        try:
            leases = await asyncio.wrap_future(parts.maps.served.lease((map_id,), version))
            try:
                directory = leases.served[0].directory
                limit = parts.max_body_bytes
                data = await LOOKS.run(_overlay, directory, body_format, body, limit, pose)
            finally:
                leases.close()
        finally:
            parts.bodies.release(body, caller.name)
    return Response(data, media_type="application/octet-stream", headers={"Cache-Control": "no-store"})


def _overlay(directory: Path, body_format: BodyFormat, body: Body, limit: int, T_map_sensor: Matrix) -> bytes:
    scan = body_format.decode(body_format.decompress(body, limit))
    found = OverlayMap.load(directory).overlay(scan, T_map_sensor)
    packed = np.empty(len(found.kind), POINT)
    packed["at"], packed["kind"] = found.points, found.kind
    return packed.tobytes()
