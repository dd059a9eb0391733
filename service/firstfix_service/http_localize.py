"""POST /localize: a scan in the body, the answer out."""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter
from typing import Any

from fastapi import APIRouter, Request, Response
from starlette.requests import ClientDisconnect

from firstfix.decode import MEDIA_TYPES
from firstfix.errors import InvalidOption
from firstfix.geopose import MEDIA_TYPE as GEOPOSE
from firstfix.localization import Localization
from firstfix.options import LocalizeOptions

from .accept import negotiated
from .answer_models import Answer
from .authorize import CallerDep
from .caller import Caller
from .client_gone import unless_client_leaves
from .localize import check_maps, check_media_type, to_json
from .parts import Parts, PartsDep

router = APIRouter(tags=["localize"])
MAP_PARAMETER = "map"
JSON = "application/json"
_OPTION_TEXT = {
    "gravity": "direction of gravity in the sensor frame, `x,y,z`, or the sensor's `roll_deg,pitch_deg`",
    "prior": "where the sensor is known to be in the map: `x,y,z,radius_m`, and it may be "
    "`,yaw_deg,yaw_range_deg`",
    "T_base_sensor": "the sensor on the robot, `x,y,z,qx,qy,qz,qw`: the answer then has `T_map_base`",
    "max_candidates": "how many places are tried at most",
    "min_probability": "below it the answer is not `localized`",
    "deadline_ms": "the answer is worthless after this time",
    "version": "digest of the map version to use instead of the active one",
}


def _openapi() -> dict[str, Any]:
    """The options are read by the core, so they are described here, not declared as parameters."""
    names = [MAP_PARAMETER, *LocalizeOptions.__dataclass_fields__]
    texts = {
        MAP_PARAMETER: "id of the map, or several separated by commas; without it all maps compete",
        **_OPTION_TEXT,
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
        "content": {GEOPOSE: {"schema": {"$ref": "#/components/schemas/GeoPose"}}},
        "headers": {"Server-Timing": {"description": "milliseconds by stage", "schema": {"type": "string"}}},
    }
}


@router.post("/localize", response_class=Response, responses=_ANSWERS, openapi_extra=_openapi())
async def localize(request: Request, parts: PartsDep, caller: CallerDep) -> Response:
    """The pose of a scan in a map, or why there is none. `Accept: application/geopose+json` asks for the
    geographic pose, which takes a map with a georeference (else 406)."""
    arrived = time.monotonic()
    try:
        form = negotiated(request.headers.get("accept"), (JSON, GEOPOSE))
        answer = await _localize(request, parts, caller, arrived, form)
        body, media_type = await _written(parts, answer, form)
    except ClientDisconnect:
        parts.metrics.failures.labels("http", "client_gone").inc()
        raise
    except Exception as error:
        parts.use_case.count("http", error)
        raise
    parts.use_case.count("http", answer)
    headers = {"Server-Timing": server_timing(answer), "Cache-Control": "no-store", "Vary": "Accept"}
    return Response(body, media_type=media_type, headers=headers)


async def _localize(
    request: Request, parts: Parts, caller: Caller, arrived: float, form: str
) -> Localization:
    options = single_values(request)
    map_id = options.pop(MAP_PARAMETER, "")
    check_maps(map_id, caller)
    LocalizeOptions.from_strings(options)  # what can be refused is refused before the body is read
    media_type = request.headers.get("content-type", "")
    check_media_type(media_type)
    if form == GEOPOSE and map_id and "," not in map_id:  # of several it is known once one has answered
        await asyncio.to_thread(parts.georeference_cache.of, map_id)
    parts.use_case.check_room(map_id, caller)
    body = await parts.bodies.read(request)
    try:
        content_encoding = request.headers.get("content-encoding")
        work = parts.use_case.localize(
            body, media_type, content_encoding, map_id, options, arrived=arrived, caller=caller
        )
        return await unless_client_leaves(request, work)
    finally:
        parts.bodies.release(body)


async def _written(parts: Parts, answer: Localization, form: str) -> tuple[bytes, str]:
    """The answer's body and media type: the geographic pose of the robot if its mount is known, else of
    the sensor. Without a pose it is JSON, which says why."""
    if form == JSON or answer.T_map_sensor is None:
        return to_json(answer), JSON
    georeference = await asyncio.to_thread(parts.georeference_cache.of, answer.map_id)
    T_map_body = answer.T_map_sensor if answer.T_map_base is None else answer.T_map_base
    return json.dumps(georeference.geopose(T_map_body)).encode(), GEOPOSE


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
