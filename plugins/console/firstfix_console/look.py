"""The way of a scan in a request's body to a worker that looks at it, as that of ``POST /localize``."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import Request

from firstfix.formats.point_cloud import Body
from firstfix_service.auth.principal import Principal
from firstfix_service.http_api.gone import cancel_when_gone
from firstfix_service.http_api.parts import LocalizeParts
from firstfix_service.query_workers.look import Look
from firstfix_service.query_workers.query import BodyFormat


async def look_at(
    request: Request,
    parts: LocalizeParts,
    caller: Principal,
    work: Callable[[Look, Body], bytes],
    map_id: str = "",
    version: str | None = None,
) -> bytes:
    """The bytes of the work on the scan in the body.

    Args:
        work, map_id, version: as in ``Look``.

    Raises:
        FirstfixError: as ``LocalizeUseCase.look`` and ``BodyReader.read``.
    """
    headers = request.headers
    body_format = BodyFormat.of(headers.get("content-type", ""), headers.get("content-encoding"))
    look = Look(caller.name, body_format, work, map_id, version)
    parts.use_case.check_room(look)
    body = await parts.bodies.read(request, caller.name)
    try:
        return await cancel_when_gone(request.scope, parts.use_case.look(look, body))
    finally:
        parts.bodies.release(body, caller.name)
