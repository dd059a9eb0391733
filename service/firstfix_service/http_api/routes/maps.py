"""/maps: submit a map for building, list the maps."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, nullcontext
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import JSONResponse

from firstfix.builds.callers import CallersKey, claim_build, claimed_build
from firstfix.errors import Conflict, NotFound, UnsupportedFormat
from firstfix.ids import is_name, new_build_id

from ...auth.principal import Principal
from ...telemetry.request_scope import with_traceparent
from ...thread_pools import CHANGES, COPIES, LISTS, READS
from ..authorize import CallerDep
from ..bodies.form_room import form_room
from ..bodies.request_body import check_declared_length, declared_length
from ..bodies.submission import Submission, from_form, from_json, keep_for_good
from ..dependencies import Parts, PartsDep
from ..schema.api_models import Build, MapDetails, MapPage, MapRemoval
from ..schema.map_submission import BODY, IDEMPOTENCY_KEY_TEXT
from ..schema.parameters import DEFAULT_LIMIT, After, Limit, MapId

router = APIRouter(prefix="/maps", tags=["maps"])
RETRY_AFTER_S = 2
_ACCEPTED = {
    "model": Build,
    "description": "recorded: the map will be built and then become the active version",
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
    """Submits a map. It is built into a new version, which then becomes the active one.

    429 `quota_exceeded`: too many builds of the caller wait or run, or its build time of today is used up.
    """
    build_id = new_build_id()
    key = None if idempotency_key is None else CallersKey(caller.repeats_as, idempotency_key)
    async with _within_quota(parts, caller, build_id, key), _received(request, parts, caller) as submission:
        if key is not None:
            fingerprint = await COPIES.run(submission.fingerprint)
            build_id = await COPIES.run(claim_build, parts.catalog.store, key, fingerprint, build_id)
        await COPIES.run(_record, parts, build_id, submission, key is not None)
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
    """The caller's maps that have a version, sorted by id."""
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
    """One map, with the manifest of its active version."""
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


@router.delete("/{map_id}")
@CHANGES.route
def delete_map(map_id: MapId, parts: PartsDep) -> MapRemoval:
    """Takes all versions of a map out of service, so that the map is no longer listed.

    Replicas stop answering within their poll interval. The next garbage collection removes the files. A build
    of the map that ends later publishes the map again: cancel it first.
    """
    return MapRemoval(map_id=map_id, retired=parts.catalog.remove_map(map_id))


@asynccontextmanager
async def _within_quota(
    parts: Parts, caller: Principal, build_id: str, key: CallersKey | None
) -> AsyncIterator[None]:
    """Counts the build against the caller's quota, before anything of a form is read.

    A repeated request, whose build is recorded already, does not count.
    """
    if key is not None and await READS.run(_is_repeated, parts, key):
        yield
        return
    async with parts.build_quota.reserve(caller.name, build_id):
        yield


@asynccontextmanager
async def _received(request: Request, parts: Parts, caller: Principal) -> AsyncIterator[Submission]:
    """The request's submission. Files of a form are on this disk until the block ends."""
    media_type = request.headers.get("content-type", "").split(";", 1)[0].strip().lower()
    if media_type == "application/json":
        submission = await from_json(request, parts, caller)
        with parts.upload_streams.request(caller.name) if submission.copies_uploads else nullcontext():
            yield submission
    elif media_type == "multipart/form-data":
        folder, declared_bytes = parts.settings.work_dir / "uploads", declared_length(request) or 0
        check_declared_length(request, parts.settings.max_upload_bytes)
        with parts.upload_streams.request(caller.name):
            async with form_room(parts.disks, parts.catalog.store, folder, declared_bytes) as room:
                yield await from_form(request, parts, caller, room)
    else:
        raise UnsupportedFormat("POST /maps accepts multipart/form-data or application/json")


def _record(parts: Parts, build_id: str, submission: Submission, repeated: bool) -> None:
    """Stores the files, then the build's record. A repeated request may find the record there."""
    record = _on_record(parts, build_id) if repeated else None
    if record is None:
        record = submission.keep(parts)
        parts.usage.begin(submission.caller.name, build_id)
        try:
            parts.catalog.put_build(build_id, with_traceparent(record))
        except Conflict:  # by the same request at the same time
            if not repeated:
                raise
    keep_for_good(parts, build_id, record, submission)


def _is_repeated(parts: Parts, key: CallersKey) -> bool:
    build_id = claimed_build(parts.catalog.store, key)
    return build_id is not None and _on_record(parts, build_id) is not None


def _on_record(parts: Parts, build_id: str) -> dict[str, Any] | None:
    try:
        return parts.catalog.build_request(build_id)
    except NotFound:
        return None
