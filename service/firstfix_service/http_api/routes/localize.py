"""POST /localize: a scan in the body, the answer out."""

from __future__ import annotations

import json
import time
from collections import Counter
from typing import Any

from fastapi import APIRouter, Request, Response
from starlette.requests import ClientDisconnect

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.geopose import MEDIA_TYPE as GEOPOSE
from firstfix.decode import MEDIA_TYPES
from firstfix.errors import InvalidOption
from firstfix.ros.media_types import POSE

from ...auth.principal import Caller
from ...lanes import READS
from ...localize.negotiation import negotiated
from ...localize.response_format import JSON, PARAMETERS, PoseReply, form_of
from ...localize.use_case import check_maps, check_media_type
from ..authorize import CallerDep
from ..dependencies import Parts, PartsDep
from ..disconnect import unless_client_leaves
from ..schema.answer_models import Answer

router = APIRouter(tags=["localize"])
MAP_PARAMETER = "map"
_OPTION_TEXT = {
    "gravity": "direction of gravity in the sensor frame, `x,y,z`, or the sensor's `roll_deg,pitch_deg`",
    "prior": "where the sensor is known to be in the map: `x,y,z,radius_m`, and it may be "
    "`,yaw_deg,yaw_range_deg`",
    "T_base_sensor": "the sensor on the robot, `x,y,z,qx,qy,qz,qw`: the answer then has `T_map_base`, and up "
    "is looked for near the robot's z first",
    "max_candidates": "how many places are tried at most",
    "min_probability": "below it the answer is not `localized`",
    "deadline_ms": "the answer is worthless after this time",
    "version": "digest of the map version to use instead of the active one",
}


def _openapi() -> dict[str, Any]:
    """The options are read by the core, so they are described here, not declared as parameters."""
    names = [MAP_PARAMETER, *LocalizeOptions.__dataclass_fields__, *PARAMETERS]
    texts = {
        MAP_PARAMETER: "id of the map, or several separated by commas; without it all maps compete",
        **_OPTION_TEXT,
        **PARAMETERS,
    }
    return {
        "parameters": [
            {
                "name": name,
                "in": "query",
                "required": False,
                "description": texts[name],
                "schema": {"type": "string"},
            }
            for name in names
        ],
        "requestBody": {
            "required": True,
            "content": {name: {"schema": {"type": "string", "format": "binary"}} for name in MEDIA_TYPES},
        },
    }


_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Answer,
        "description": "the answer, also when the scan was not localized: that is `application/json` "
        "whatever was asked for, as there is no pose",
        "content": {
            GEOPOSE: {"schema": {"$ref": "#/components/schemas/GeoPose"}},
            POSE: {"schema": {"type": "string", "format": "binary"}},
        },
        "headers": {"Server-Timing": {"description": "milliseconds by stage", "schema": {"type": "string"}}},
    }
}


@router.post("/localize", response_class=Response, responses=_ANSWERS, openapi_extra=_openapi())
async def localize(request: Request, parts: PartsDep, caller: CallerDep) -> Response:
    """The pose of a scan in a map, or why there is none. `Accept: application/geopose+json` asks for the
    geographic pose, which takes a map with a georeference (else 406), and that of a ROS pose message for
    one."""
    arrived = time.monotonic()
    try:
        answer, (content, media_type) = await _localize(request, parts, caller, arrived)
    except ClientDisconnect:
        parts.metrics.failures.labels("http", "client_gone").inc()
        raise
    except Exception as error:
        parts.use_case.count("http", error)
        raise
    parts.use_case.count("http", answer)
    headers = {"Server-Timing": server_timing(answer), "Cache-Control": "no-store", "Vary": "Accept"}
    return Response(content, media_type=media_type, headers=headers)


async def _localize(
    request: Request, parts: Parts, caller: Caller, arrived: float
) -> tuple[Localization, tuple[bytes, str]]:
    """The answer, and the form in which it was asked for."""
    options, accept = single_values(request), request.headers.get("accept", "")
    pose = PoseReply.wanted(accept, options)
    is_geographic = pose is None and negotiated(accept, (JSON, GEOPOSE)) == GEOPOSE
    map_id = options.pop(MAP_PARAMETER, "")
    check_maps(map_id, caller)
    LocalizeOptions.from_strings(options)  # what can be refused is refused before the body is read
    media_type = request.headers.get("content-type", "")
    check_media_type(media_type)
    if is_geographic and map_id and "," not in map_id:  # of several it is known once one has answered
        await READS.run(parts.georeference_cache.of, map_id)
    parts.use_case.check_room(map_id, caller)
    body = await parts.bodies.read(request)
    try:
        content_encoding = request.headers.get("content-encoding")
        work = parts.use_case.localize(
            body, media_type, content_encoding, map_id, options, arrived=arrived, caller=caller
        )
        answer = await unless_client_leaves(request, work)
        if is_geographic and answer.T_map_sensor is not None:
            return answer, (await _geographic(parts, answer), GEOPOSE)
        return answer, form_of(answer, pose, body, media_type, content_encoding)
    finally:
        parts.bodies.release(body)


async def _geographic(parts: Parts, answer: Localization) -> bytes:
    """The geographic pose of the robot if its mount is known, else of the sensor."""
    assert answer.T_map_sensor is not None
    georeference = await READS.run(parts.georeference_cache.of, answer.map_id)
    T_map_body = answer.T_map_sensor if answer.T_map_base is None else answer.T_map_base
    return json.dumps(georeference.geopose(T_map_body)).encode()


def single_values(request: Request) -> dict[str, str]:
    """The query parameters, each given once.

    Raises:
        InvalidOption: one is given twice: taking either would ignore the other.
    """
    counts = Counter(name for name, _ in request.query_params.multi_items())
    twice = sorted(name for name, count in counts.items() if count > 1)
    if twice:
        raise InvalidOption(f"given more than once: {', '.join(twice)}")
    return dict(request.query_params)


def server_timing(answer: Localization) -> str:
    """The stages as a Server-Timing header, which browsers and proxies show."""
    return ", ".join(f"{stage};dur={ms:.3f}" for stage, ms in answer.timings_ms.items())
