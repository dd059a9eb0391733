"""GET /answers/events: the answers of the replicas as they give them, as server-sent events."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any

import orjson
from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse

from firstfix.access.permissions import Scope
from firstfix.ids import check_map_id
from firstfix_service.auth.principal import Principal
from firstfix_service.http_api.edge import CallerDep, PermissionDep, needs
from firstfix_service.http_api.event_stream import EventStreamsDep
from firstfix_service.http_api.parts import part
from firstfix_service.localize.recent_answers import RecentAnswer, RecentAnswers

router = APIRouter(prefix="/answers", tags=["answers"])
LOOK_S = 0.25  # between looks for new answers
TOGETHER = 32  # events in one part of a stream: each part passes through the whole server
_EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "First `event: watching`, `data`: `replica`, and `all_replicas`: whether answers of "
        "others come, too. Then `event: answer`, `id` its number, `data`: `number`, `replica`, `time_s` "
        "since the epoch, `caller`, `robot` (as `X-Robot` said, else the name of its key), "
        "`transport`, `ms`, and `answer` as `POST /localize` gave it. Of other "
        "replicas it has only `verdict`, `reasons`, `probability`, `map_id`, `map_version` and "
        "`T_map_sensor`",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}


@router.get("/events", response_class=StreamingResponse, responses=_EVENTS)
@needs(Scope.BUILD)
async def get_answer_events(
    recent: Annotated[RecentAnswers, part(RecentAnswers)],
    streams: EventStreamsDep,
    caller: CallerDep,
    permission: PermissionDep,
    map_id: Annotated[str | None, Query(description="only answers in this map")] = None,
    after: Annotated[
        int, Query(ge=0, description="only answers with higher numbers; 0: also the last 500 that were given")
    ] = 0,
) -> StreamingResponse:
    """Answers about the caller's maps, until the caller's key or token is no longer valid.

    Replicas tell each other of their answers over zenoh, where it is on and keeps strangers away. Otherwise
    each replica tells of its own alone. Of many answers at a time some may be left out.
    """
    if map_id is not None:
        caller.check_map(check_map_id(map_id))
    events = _events(recent, caller, map_id, after)
    return streams.open(caller.name, permission, map_id, events, LOOK_S, recent.watched())


async def _events(
    recent: RecentAnswers, caller: Principal, map_id: str | None, after: int
) -> AsyncIterator[bytes]:
    yield _watching(recent)  # the headers go out at once
    while True:
        newer = recent.after(after)
        after = newer[-1].number if newer else after
        shown = [one for one in newer if _is_shown(one, caller, map_id)]
        for begin in range(0, len(shown), TOGETHER):
            yield b"".join(one.event for one in shown[begin : begin + TOGETHER])
        yield b""


def _is_shown(one: RecentAnswer, caller: Principal, map_id: str | None) -> bool:
    sees = caller.sees(one.map_id) if one.map_id else caller.sees_every_map
    return sees and map_id in (None, one.map_id)


def _watching(recent: RecentAnswers) -> bytes:
    data = orjson.dumps({"replica": recent.replica, "all_replicas": recent.hears_others})
    return b"event: watching\ndata: %s\n\n" % data
