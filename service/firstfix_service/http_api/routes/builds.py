"""/builds: which there are, how far one is, and stopping it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response

from firstfix.builds.records import FINAL_STATES
from firstfix.errors import NotFound
from firstfix.ids import check_map_id

from ...builds.queue import cancel_build as cancel_build_anywhere
from ...lanes import CHANGES, LISTS, READS
from ..authorize import CallerDep
from ..dependencies import PartsDep
from ..schema.api_models import Build, BuildPage
from ..schema.paging import DEFAULT_LIMIT, After, Limit
from ..schema.path_parameters import BuildId

router = APIRouter(prefix="/builds", tags=["builds"])
RETRY_AFTER_S = 2
LOOKED_AT = 1000  # records that one page looks at, however few of them it shows


@router.get("")
@LISTS.route
def get_builds(
    parts: PartsDep,
    caller: CallerDep,
    map_id: Annotated[str | None, Query(max_length=63, description="only this map's")] = None,
    state: Annotated[
        Literal["queued", "running", "succeeded", "failed", "cancelled", "unreadable"] | None,
        Query(description="only those in this state"),
    ] = None,
    limit: Limit = DEFAULT_LIMIT,
    after: After = None,
) -> BuildPage:
    """Builds of the caller's maps on record, newest first. A page can be short and yet not the last:
    `next` says."""
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
    """State, stage, progress, error, and the version once it has succeeded. `unreadable`: its record in the
    store is damaged."""
    status = parts.catalog.shown_status(build_id)
    if status["state"] not in FINAL_STATES:
        response.headers["Retry-After"] = str(RETRY_AFTER_S)
    return Build.model_validate({"build_id": build_id, **status})


@router.delete("/{build_id}", status_code=202)
@CHANGES.route
def cancel_build(build_id: BuildId, parts: PartsDep) -> Build:
    """Asks the build to stop. One that waits is cancelled at once, a running one within seconds: its
    status says when."""
    return Build.model_validate({"build_id": build_id, **cancel_build_anywhere(parts.catalog, build_id)})
