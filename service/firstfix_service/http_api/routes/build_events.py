"""GET /builds/{id}/events: the progress of a build as server-sent events."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from contextlib import ExitStack, suppress
from typing import Any

import structlog
from fastapi import APIRouter
from fastapi.responses import StreamingResponse

from firstfix.builds.records import FINAL_STATES
from firstfix.errors import FirstfixError, StoreUnavailable

from ...auth.permission import Permission, PermissionDep
from ...thread_pools import READS
from ..edge import CallerDep
from ..event_stream import HEARTBEAT, HEARTBEAT_S, EventStream
from ..parts import Parts, PartsDep
from ..schema.parameters import BuildId

router = APIRouter(prefix="/builds", tags=["builds"])
_log = structlog.get_logger(__name__)
LOOK_S = 1.0  # between reads of the status, which its writer renews twice a second
_EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "`event: progress` with the status as `data` at every change, then `event: end` with "
        "the final status. Comment lines keep the connection alive. Open the stream again if it ends without "
        "`end`",
        "content": {
            "text/event-stream": {
                "schema": {"type": "string"},
                "example": 'event: progress\ndata: {"build_id": "...", "state": "running"}\n\n',
            }
        },
    }
}


@router.get("/{build_id}/events", response_class=StreamingResponse, responses=_EVENTS)
async def get_build_events(
    build_id: BuildId, parts: PartsDep, caller: CallerDep, permission: PermissionDep
) -> StreamingResponse:
    """The build's status as it changes, until it ends or the caller's key or token is no longer valid."""
    status = await READS.run(parts.catalog.build_status, build_id)
    counted = ExitStack()
    counted.enter_context(parts.event_streams.request(caller.name))
    return EventStream(_events(parts, permission, build_id, status), counted)


async def _events(
    parts: Parts, permission: Permission, build_id: str, status: dict[str, Any]
) -> AsyncIterator[bytes]:
    """Events until the build ends, the service stops or the permission ends."""
    said: dict[str, Any] | None = None
    last = time.monotonic()
    while status["state"] not in FINAL_STATES:
        if status != said:
            yield _event("progress", build_id, status)
            said, last = status, time.monotonic()
        elif time.monotonic() - last > HEARTBEAT_S:
            yield HEARTBEAT
            last = time.monotonic()
        with suppress(TimeoutError):
            async with asyncio.timeout(LOOK_S):
                await parts.closing.wait()
        if parts.closing.is_set():
            return
        try:
            await permission.check(status["map_id"])
        except FirstfixError as error:
            _log.info("a stream of events ended: its caller has lost the permission", code=error.code)
            return
        try:
            status = await READS.run(parts.catalog.build_status, build_id)
        except StoreUnavailable as error:  # it comes back, or the caller gives up
            _log.warning("cannot read the build's status", build_id=build_id, error=str(error))
        except FirstfixError:  # its record was removed
            return
    yield _event("end", build_id, status)


def _event(name: str, build_id: str, status: dict[str, Any]) -> bytes:
    data = json.dumps({"build_id": build_id, **status}, separators=(",", ":"))
    return f"event: {name}\ndata: {data}\n\n".encode()
