"""POST /localize: the pose of the scan in the body."""

from __future__ import annotations

import json
import time
from typing import Any
from urllib.parse import parse_qsl

from fastapi import FastAPI, Request, Response
from starlette.requests import ClientDisconnect
from starlette.types import Scope as ASGIScope

from firstfix.access.permissions import Scope
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.geopose import MEDIA_TYPE as GEOPOSE
from firstfix.ros.media_types import POSE
from firstfix.scan_formats import MEDIA_TYPES

from ...auth.principal import Principal
from ...localize.use_case import LocalizeUseCase
from ...query_workers.answer_form import PARAMETERS, AnswerForm
from ...query_workers.query import (
    MAP_PARAMETER,
    AsGiven,
    Query,
    remembered,
    single_values,
    split_map_ids,
)
from ...telemetry.request_scope import note, note_robot
from ...thread_pools import READS
from ..edge import needs
from ..gone import cancel_when_gone
from ..parts import LocalizeParts, part_of
from ..schema.answer_models import Answer, GeoPose
from ..schema.bodies import BINARY, add_schema, binary_body
from ..short_way import DirectRoute, EncodedResponse

_OPTION_TEXT = {
    "gravity": "direction of gravity in the sensor frame, `x,y,z`, or the sensor's `roll_deg,pitch_deg`",
    "prior": "region of the map that contains the sensor: `x,y,z,radius_m`, optionally with "
    "`,yaw_deg,yaw_range_deg`",
    "T_base_sensor": "pose of the sensor on the robot, `x,y,z,qx,qy,qz,qw`: the answer then has "
    "`T_map_base`, and directions near the robot's z axis are tried first as up",
    "max_candidates": "limit of the places to try",
    "min_probability": "an answer with a lower probability is not `localized`",
    "max_false_accept": "instead of `min_probability`: of scans whose place is not in the map or not found, "
    "at most this share is answered `localized`, with 95 % confidence; `invalid_option` if the map cannot "
    "promise it",
    "deadline_ms": "milliseconds after which an answer is of no use: the request then fails",
    "version": "digest of the map version to use instead of the active version, or its first characters, 4 "
    "or more",
    "dropped": "points that the caller left out of the scan, for the findings: "
    "`not_finite,too_far,far_m,spread_m`",
    "T_odom_base": "pose of the robot's base at the scan's stamp in its odometry's frame, "
    "`x,y,z,qx,qy,qz,qw`; without `T_base_sensor`, of the sensor. It changes no answer, but recorded queries "
    "with it can confirm each other",
    "twist": "motion of the sensor during the scan, `vx,vy,vz,wx,wy,wz` (m/s, rad/s; sensor frame at the "
    "scan's stamp), for a scan whose points have times: otherwise it is solved with the pose",
}


_ROBOT_TEXT = (
    "name of the robot, for people who watch answers and for the log: up to 64 of `A-Z a-z 0-9 . _ : @ / -`. "
    "Of robots that share a key or an address"
)


def _openapi() -> dict[str, Any]:
    """The operation's parameters: the core parses the options, so FastAPI cannot derive them."""
    names = [MAP_PARAMETER, *LocalizeOptions.__dataclass_fields__, *PARAMETERS]
    texts = {
        MAP_PARAMETER: "id of the map, or several ids separated by commas; without it all maps that "
        "the caller may see are searched: up to 16 in full, of more the eight that resemble the scan most",
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
        ]
        + [
            {
                "name": "X-Robot",
                "in": "header",
                "required": False,
                "description": _ROBOT_TEXT,
                "schema": {"type": "string"},
            }
        ],
        **binary_body(MEDIA_TYPES),
    }


_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Answer,
        "description": "the answer, also if the scan was not localized: then it has no pose and is always "
        "`application/json`",
        "content": {
            GEOPOSE: {"schema": {"$ref": add_schema(GeoPose)}},
            POSE: BINARY,
        },
        "headers": {
            "Server-Timing": {"description": "milliseconds of each stage", "schema": {"type": "string"}}
        },
    }
}


_GONE = "client_gone"  # in metrics and the log, where others have the code of an error
_ALWAYS = ((b"cache-control", b"no-store"), (b"vary", b"Accept"))


def add_route(app: FastAPI) -> None:
    """Add the route to the app."""
    app.router.add_api_route(
        "/localize",
        localize,
        methods=["POST"],
        tags=["localize"],
        response_class=Response,
        responses=_ANSWERS,
        openapi_extra=_openapi(),
        route_class_override=DirectRoute,
    )


@needs(Scope.LOCALIZE, "localize", has_queue=True)
async def localize(request: Request) -> Response:
    """The pose of a scan in a map, or the reasons why there is none.

    `Accept: application/geopose+json` asks for the geographic pose; 406 if the map has no georeference.
    `Accept` with the media type of a ROS pose message asks for that message.
    """
    arrived = time.monotonic()
    parts, caller = part_of(request, LocalizeParts), request.scope["state"]["caller"]
    use_case = parts.use_case
    try:
        query = _query_of(request.scope, caller, use_case, arrived)
        use_case.check_room(query)
        given = query.given
        if given.form.geographic and len(given.map_ids) == 1:  # of several maps, one has to answer first
            await READS.run(parts.georeference_cache.of, given.map_ids[0])
        body = await parts.bodies.read_permitted(request, caller.name)
        try:
            answer = await cancel_when_gone(request.scope, use_case.localize(query, body))
            content, media_type = answer.content
            if answer.T_map_body is not None:
                georeference = await READS.run(parts.georeference_cache.of, answer.map_id)
                content = json.dumps(georeference.geopose(answer.T_map_body)).encode()
                media_type = GEOPOSE
        finally:
            parts.bodies.release(body, caller.name)
    except ClientDisconnect:
        parts.metrics.failures.labels("http", _GONE).inc()
        note(code=_GONE)
        raise
    except Exception as error:
        use_case.count("http", error)
        raise
    use_case.count("http", answer)
    return EncodedResponse(
        content,
        (
            (b"server-timing", answer.server_timing),
            *_ALWAYS,
            (b"content-length", b"%d" % len(content)),
            (b"content-type", media_type.encode("latin-1")),
        ),
    )


def _query_of(scope: ASGIScope, caller: Principal, use_case: LocalizeUseCase, arrived: float) -> Query:
    """The query that the head of a request asks.

    Raises:
        FirstfixError: as ``Query.read``, or the robot's name is malformed.
    """
    headers = dict(reversed(scope["headers"]))  # of several, the first counts
    if b"x-robot" in headers:
        note_robot(headers[b"x-robot"].decode("latin-1"))
    given = _read(
        scope["query_string"],
        headers.get(b"accept", b""),
        headers.get(b"content-type", b""),
        headers.get(b"content-encoding", b""),
    )
    return Query.read(given, caller, use_case.served, arrived)


@remembered
def _read(*head: bytes) -> AsGiven:
    """Parse what a head asks for, by itself.

    Args:
        head: query string, and the values of Accept, Content-Type and Content-Encoding.

    Raises:
        InvalidOption: a parameter is given twice, or as ``AnswerForm.of``.
        NotAcceptable: as ``AnswerForm.of``.
    """
    query, accept, media_type, encoding = (text.decode("latin-1") for text in head)
    options = single_values(parse_qsl(query, keep_blank_values=True))
    form = AnswerForm.of(accept, options, may_be_geographic=True)
    return AsGiven(split_map_ids(options.pop(MAP_PARAMETER, "")), media_type, encoding, options, form)
