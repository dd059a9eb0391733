"""/builds: list builds, see the progress of one as it is and as events, cancel one."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Annotated, Any, Literal

import structlog
from fastapi import APIRouter, Query, Response
from fastapi.responses import PlainTextResponse, StreamingResponse

from firstfix.access.permissions import Scope
from firstfix.builds.records import FINAL_STATES
from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError, NotFound, StoreUnavailable
from firstfix.ids import check_map_id

from ...builds.queue import BuildQueue, waits_for
from ...builds.queue import cancel_build as cancel_build_anywhere
from ...thread_pools import CHANGES, LISTS, READS
from ..edge import CallerDep, PermissionDep, needs
from ..event_stream import EventStreamsDep
from ..parts import BuildPartsDep
from ..schema.api_models import Build, BuildPage
from ..schema.parameters import DEFAULT_LIMIT, After, BuildId, Limit

router = APIRouter(prefix="/builds", tags=["builds"])
_log = structlog.get_logger(__name__)
RETRY_AFTER_S = 2
LOOK_S = 1.0  # between reads of the status for events, which its writer renews twice a second
LOOKED_AT = 1000  # records that are read for one page, however few of them match
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


@router.get("")
@needs(Scope.BUILD)
@LISTS.route
def get_builds(
    builds: BuildPartsDep,
    caller: CallerDep,
    map_id: Annotated[str | None, Query(max_length=63, description="only builds of this map")] = None,
    state: Annotated[
        Literal["queued", "running", "succeeded", "failed", "cancelled", "unreadable"] | None,
        Query(description="only builds in this state"),
    ] = None,
    limit: Limit = DEFAULT_LIMIT,
    after: After = None,
) -> BuildPage:
    """Recorded builds of the caller's maps, newest first.

    A short page need not be the last one: see `next`.
    """
    if map_id is not None:
        check_map_id(map_id)
    catalog = builds.catalog
    older = [name for name in reversed(catalog.builds.ids()) if after is None or name < after]
    found: list[dict[str, Any]] = []
    following = None
    for looked_at, build_id in enumerate(older, 1):
        try:
            status = catalog.builds.shown_status(build_id)
        except NotFound:  # its record was collected just now
            continue
        wanted = map_id in (None, status["map_id"]) and state in (None, status["state"])
        if wanted and caller.sees(status["map_id"]):
            found.append(_shown(builds.queue, build_id, status))
        if (len(found) == limit or looked_at == LOOKED_AT) and looked_at < len(older):
            following = build_id
            break
    return BuildPage.model_validate({"builds": found, "next": following})


@router.get("/{build_id}")
@needs(Scope.BUILD)
@READS.route
def get_build(build_id: BuildId, builds: BuildPartsDep, caller: CallerDep, response: Response) -> Build:
    """State, stage, progress, error, and the version of a build that has succeeded.

    Of a build that has ended also its stages, with what each has taken over from earlier builds.

    State `unreadable`: the build's record in the store is damaged.
    """
    details = builds.catalog.builds.details(build_id)
    sees_who = details["caller"] == caller.name or caller.grant.allows(Scope.ADMIN)
    if not details["caller"] or not sees_who:
        del details["caller"]
    if details["state"] not in FINAL_STATES:
        response.headers["Retry-After"] = str(RETRY_AFTER_S)
    return Build.model_validate(_shown(builds.queue, build_id, details))


@router.get("/{build_id}/log", response_class=PlainTextResponse)
@needs(Scope.ADMIN)
@READS.route
def get_build_log(build_id: BuildId, builds: BuildPartsDep) -> PlainTextResponse:
    """The end of the log of the build's processes, up to 64 KiB, for admins: it names files of the machine.

    It is kept whenever an attempt at the build has ended.
    """
    return PlainTextResponse(builds.catalog.builds.log(build_id))


@router.delete("/{build_id}", status_code=202)
@needs(Scope.BUILD)
@CHANGES.route
def cancel_build(build_id: BuildId, builds: BuildPartsDep) -> Build:
    """Ask the build to stop.

    A waiting build is cancelled at once, a running one within seconds. Its status says when.
    """
    status = cancel_build_anywhere(builds.catalog, build_id)
    return Build.model_validate(_shown(builds.queue, build_id, status))


@router.get("/{build_id}/events", response_class=StreamingResponse, responses=_EVENTS)
@needs(Scope.BUILD)
async def get_build_events(
    build_id: BuildId,
    builds: BuildPartsDep,
    streams: EventStreamsDep,
    caller: CallerDep,
    permission: PermissionDep,
) -> StreamingResponse:
    """The build's status as it changes, until it ends or the caller's key or token is no longer valid."""
    status = await READS.run(builds.catalog.builds.status, build_id)
    events = _events(builds.catalog, builds.queue, build_id, status)
    return streams.open(caller.name, permission, status["map_id"], events, LOOK_S)


async def _events(
    catalog: Catalog, queue: BuildQueue | None, build_id: str, status: dict[str, Any]
) -> AsyncIterator[bytes]:
    """Events until the build ends."""
    sent: dict[str, Any] | None = None
    while status["state"] not in FINAL_STATES:
        shown = _shown(queue, build_id, status)
        if shown != sent:
            yield _event("progress", shown)
            sent = shown
        yield b""
        try:
            status = await READS.run(catalog.builds.status, build_id)
        except StoreUnavailable as error:  # it comes back, or the caller gives up
            _log.warning("cannot read the build's status", build_id=build_id, error=str(error))
        except FirstfixError:  # its record was removed
            return
    yield _event("end", _shown(queue, build_id, status))


def _shown(queue: BuildQueue | None, build_id: str, status: dict[str, Any]) -> dict[str, Any]:
    return {"build_id": build_id, **status, "waits_for": waits_for(queue, status["state"])}


def _event(name: str, shown: dict[str, Any]) -> bytes:
    data = json.dumps(shown, separators=(",", ":"))
    return f"event: {name}\ndata: {data}\n\n".encode()
