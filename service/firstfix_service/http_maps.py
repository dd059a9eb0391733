"""/maps: hand a map in, see what there is."""

from __future__ import annotations

import shutil
import uuid
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import JSONResponse

from firstfix.errors import Conflict, NotFound, UnsupportedFormat
from firstfix.idempotency import claim_build
from firstfix.ids import is_name, new_build_id

from .api_models import Build, MapDetails, MapPage
from .authorize import CallerDep
from .caller import Caller
from .lanes import COPIES, LISTS, READS
from .maps_request import BODY, IDEMPOTENCY_KEY_TEXT
from .paging import DEFAULT_LIMIT, After, Limit
from .parts import Parts, PartsDep
from .path_parameters import MapId
from .request_scope import with_traceparent
from .submission import Submission, from_form, from_json, keep_for_good

router = APIRouter(prefix="/maps", tags=["maps"])
RETRY_AFTER_S = 2
_ACCEPTED = {
    "model": Build,
    "description": "recorded: it is built, then becomes the active version",
    "headers": {
        "Location": {"description": "`/builds/{build_id}`", "schema": {"type": "string"}},
        "Retry-After": {"description": "seconds", "schema": {"type": "string"}},
    },
}


@router.post("", status_code=202, response_class=JSONResponse, responses={202: _ACCEPTED}, openapi_extra=BODY)
async def post_map(
    request: Request,
    parts: PartsDep,
    caller: CallerDep,
    idempotency_key: Annotated[
        str | None,
        Header(min_length=1, max_length=255, pattern="^[\\x21-\\x7e]+$", description=IDEMPOTENCY_KEY_TEXT),
    ] = None,
) -> Response:
    """Hands in a map: it is built into a new version, which then becomes the active one."""
    build_id = new_build_id()
    async with _received(request, parts, caller) as submission:
        if idempotency_key is not None:
            fingerprint = await COPIES.run(submission.fingerprint)
            build_id = await COPIES.run(
                claim_build, parts.catalog.store, idempotency_key, fingerprint, build_id
            )
        await COPIES.run(_record, parts, build_id, submission, idempotency_key is not None)
    if parts.builds is not None:
        await parts.builds.submit(build_id)
    status = await READS.run(parts.catalog.build_status, build_id)
    headers = {"Location": f"/builds/{build_id}", "Retry-After": str(RETRY_AFTER_S)}
    return JSONResponse({"build_id": build_id, **status}, 202, headers)


@router.get("")
@LISTS.route
def get_maps(
    parts: PartsDep, caller: CallerDep, limit: Limit = DEFAULT_LIMIT, after: After = None
) -> MapPage:
    """The caller's maps that have a version to serve, by their ids."""
    found: list[dict[str, Any]] = []
    for map_id in parts.catalog.store.folders("maps"):
        if not is_name(map_id) or map_id <= (after or "") or not caller.sees(map_id):
            continue
        state = parts.catalog.state(map_id)
        if state.published:
            if len(found) == limit:
                return MapPage.model_validate({"maps": found, "next": found[-1]["map_id"]})
            found.append({"map_id": map_id, "active_version": state.active})
    return MapPage.model_validate({"maps": found, "next": None})


@router.get("/{map_id}", response_model=MapDetails, response_model_exclude_unset=True)
@READS.route
def get_map(map_id: MapId, parts: PartsDep) -> dict[str, Any]:
    """One map, with what the manifest of its active version says."""
    state = parts.catalog.state(map_id)
    if not state.exists:
        raise NotFound(f"no map {map_id}")
    described: dict[str, Any] = {
        "map_id": map_id,
        "active_version": state.active,
        "versions": len(state.published),
    }
    if state.active is not None:
        described["manifest"] = parts.catalog.manifest(map_id, state.active).to_mapping()
    return described


@asynccontextmanager
async def _received(request: Request, parts: Parts, caller: Caller) -> AsyncIterator[Submission]:
    """What the request hands in; files of a form are on this disk meanwhile."""
    media_type = request.headers.get("content-type", "").split(";", 1)[0].strip().lower()
    if media_type == "application/json":
        yield await from_json(request, parts, caller)
    elif media_type == "multipart/form-data":
        directory = parts.settings.work_dir / "uploads" / uuid.uuid4().hex
        directory.mkdir(parents=True)
        try:
            yield await from_form(request, parts, caller, directory)
        finally:
            await COPIES.run(shutil.rmtree, directory, ignore_errors=True)
    else:
        raise UnsupportedFormat("POST /maps takes multipart/form-data or application/json")


def _record(parts: Parts, build_id: str, submission: Submission, repeated: bool) -> None:
    """Puts the build on record, its files first. A repeated request may find it there."""
    record = _on_record(parts, build_id) if repeated else None
    if record is None:
        record = submission.keep(parts)
        try:
            parts.catalog.put_build(build_id, with_traceparent(record))
        except Conflict:  # by the same request at the same time
            if not repeated:
                raise
    keep_for_good(parts, build_id, record, submission)


def _on_record(parts: Parts, build_id: str) -> dict[str, Any] | None:
    try:
        return parts.catalog.build_request(build_id)
    except NotFound:
        return None
