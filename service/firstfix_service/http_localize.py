"""POST /localize: a scan in the body, the answer out."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

from fastapi import APIRouter, Request, Response

from firstfix.decode import MEDIA_TYPES
from firstfix.errors import InvalidOption
from firstfix.localization import Localization
from firstfix.options import LocalizeOptions
from firstfix.ros.media_types import POSE

from .localize import check_media_type
from .parts import PartsDep
from .pose_reply import PARAMETERS, PoseReply, form_of

router = APIRouter(tags=["localize"])
MAP_PARAMETER = "map"
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
        "responses": {
            "200": {
                "description": "the answer, also when the scan was not localized: then it is always JSON",
                "content": {POSE: {"schema": {"type": "string", "format": "binary"}}},
            },
        },
    }


@router.post("/localize", openapi_extra=_openapi())
async def localize(request: Request, parts: PartsDep) -> Response:
    """The pose of a scan in a map, or why there is none."""
    arrived = time.monotonic()
    try:
        answer, (content, form) = await _localize(request, parts, arrived)
    except Exception as error:
        parts.use_case.count("http", error)
        raise
    parts.use_case.count("http", answer)
    return Response(
        content,
        media_type=form,
        headers={"Server-Timing": server_timing(answer), "Cache-Control": "no-store", "Vary": "Accept"},
    )


async def _localize(
    request: Request, parts: PartsDep, arrived: float
) -> tuple[Localization, tuple[bytes, str]]:
    """The answer, and the form in which it was asked for."""
    options = single_values(request)
    pose = PoseReply.wanted(request.headers.get("accept", ""), options)
    map_id = options.pop(MAP_PARAMETER, "")
    LocalizeOptions.from_strings(options)  # what can be refused is refused before the body is read
    media_type = request.headers.get("content-type", "")
    check_media_type(media_type)
    parts.pool.check_room()
    body = await parts.bodies.read(request)
    content_encoding = request.headers.get("content-encoding")
    try:
        answer = await parts.use_case.localize(
            body, media_type, content_encoding, map_id, options, arrived=arrived
        )
        return answer, form_of(answer, pose, body, media_type, content_encoding)
    finally:
        parts.bodies.release(body)


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
