"""/maps/{map_id}/patch: a build that lays into the map what recorded queries of several robots confirm."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse

from firstfix.access.permissions import Scope
from firstfix.ids import new_build_id
from firstfix.maintenance.patch import patch_request
from firstfix.maintenance.rebuild import record_again

from ...auth.principal import Principal
from ...builds.queue import waits_for
from ...telemetry.request_scope import with_traceparent
from ...thread_pools import COPIES, READS
from ..edge import CallerDep, needs
from ..parts import BuildParts, BuildPartsDep
from ..schema.api_models import Build
from ..schema.parameters import MapId

router = APIRouter(prefix="/maps/{map_id}", tags=["maps"])
RETRY_AFTER_S = 2
_ACCEPTED: dict[str, Any] = {
    "model": Build,
    "description": "recorded: the build fails with the reason if no change is confirmed",
    "headers": {
        "Location": {"description": "`/builds/{build_id}`", "schema": {"type": "string"}},
        "Retry-After": {"description": "seconds", "schema": {"type": "string"}},
    },
}


@router.post("/patch", status_code=202, response_class=JSONResponse, responses={202: _ACCEPTED})
@needs(Scope.BUILD, "build")
async def post_patch(
    map_id: MapId,
    builds: BuildPartsDep,
    caller: CallerDep,
    mode: Annotated[
        Literal["propose", "activate"] | None,
        Query(
            description="`propose`: the patched version waits until somebody activates it; `activate`: it is "
            "activated, unless it is worse; default: `patch` of the map's build config"
        ),
    ] = None,
) -> JSONResponse:
    """Patch the active version: what several robots have seen for days is added to the map, or removed.

    Recorded queries are the evidence. `POST /maps/{map_id}/rollback` takes an activated patch back.

    409: patches of the map are off and no mode is given, or its active version is provisional.
    """
    build_id = new_build_id()
    async with builds.quota.reserve(caller.name, build_id):
        await COPIES.run(_record, builds, caller, build_id, map_id, mode)
    if builds.queue is not None:
        await builds.queue.submit(build_id)
    status = await READS.run(builds.catalog.builds.status, build_id)
    headers = {"Location": f"/builds/{build_id}", "Retry-After": str(RETRY_AFTER_S)}
    shown = {"build_id": build_id, **status, "waits_for": waits_for(builds.queue, status["state"])}
    return JSONResponse(shown, 202, headers)


def _record(
    builds: BuildParts,
    caller: Principal,
    build_id: str,
    map_id: str,
    mode: Literal["propose", "activate"] | None,
) -> None:
    request = {**patch_request(builds.catalog, map_id, mode), "owner": caller.name}
    builds.usage.begin(caller.name, build_id)
    record_again(builds.catalog, map_id, with_traceparent(request), build_id)
