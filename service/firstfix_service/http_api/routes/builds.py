"""/builds: list builds, see the progress of one, cancel one."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response

from firstfix.builds.records import FINAL_STATES
from firstfix.errors import NotFound, UnreadableRecord
from firstfix.ids import check_map_id

from ...builds.queue import cancel_build as cancel_build_anywhere
from ...thread_pools import CHANGES, LISTS, READS
from ..edge import CallerDep
from ..parts import PartsDep
from ..schema.api_models import Build, BuildPage
from ..schema.parameters import DEFAULT_LIMIT, After, BuildId, Limit

router = APIRouter(prefix="/builds", tags=["builds"])
RETRY_AFTER_S = 2
LOOKED_AT = 1000  # records that are read for one page, however few of them match


@router.get("")
@LISTS.route
def get_builds(
    parts: PartsDep,
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
    older = [name for name in reversed(parts.catalog.build_ids()) if after is None or name < after]
    found: list[dict[str, Any]] = []
    following = None
    for looked_at, build_id in enumerate(older, 1):
        try:
            status = parts.catalog.shown_status(build_id)
        except NotFound:  # its record was collected just now
            continue
        wanted = map_id in (None, status["map_id"]) and state in (None, status["state"])
        if wanted and caller.sees(status["map_id"]):
            found.append({"build_id": build_id, **status})
        if (len(found) == limit or looked_at == LOOKED_AT) and looked_at < len(older):
            following = build_id
            break
    return BuildPage.model_validate({"builds": found, "next": following})


@router.get("/{build_id}")
@READS.route
def get_build(build_id: BuildId, parts: PartsDep, response: Response) -> Build:
    """State, stage, progress, error, and the version of a build that has succeeded.

    Of a build that has ended also its stages, with what each has taken over from earlier builds.

    State `unreadable`: the build's record in the store is damaged.
    """
    status = parts.catalog.shown_status(build_id)
    if status["state"] not in FINAL_STATES:
        response.headers["Retry-After"] = str(RETRY_AFTER_S)
        return Build.model_validate({"build_id": build_id, **status})
    return Build.model_validate({"build_id": build_id, **status, "stages": _stages(parts, build_id)})


@router.delete("/{build_id}", status_code=202)
@CHANGES.route
def cancel_build(build_id: BuildId, parts: PartsDep) -> Build:
    """Asks the build to stop.

    A waiting build is cancelled at once, a running one within seconds. Its status says when.
    """
    return Build.model_validate({"build_id": build_id, **cancel_build_anywhere(parts.catalog, build_id)})


def _stages(parts: PartsDep, build_id: str) -> list[dict[str, Any]]:
    try:
        return parts.catalog.build_stages(build_id)
    except UnreadableRecord:  # they are for people: the build's state does not depend on them
        return []
