"""/maps: submit a map for building, list the maps."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, nullcontext
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import JSONResponse

from firstfix.access.permissions import Scope
from firstfix.builds.callers import CallersKey, claim_build, claimed_build
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.described import map_details, map_summary
from firstfix.errors import Conflict, NotFound, UnsupportedFormat
from firstfix.ids import is_name, new_build_id

from ...auth.principal import Principal
from ...builds.queue import waits_for
from ...telemetry.request_scope import with_traceparent
from ...thread_pools import CHANGES, COPIES, LISTS, READS
from ..bodies.form import form_directory
from ..bodies.request_body import checked_length
from ..bodies.submission import Submission, from_form, from_json, keep_for_good
from ..edge import CallerDep, needs
from ..parts import BuildParts, BuildPartsDep, CatalogDep, UploadParts, UploadPartsDep
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
@needs(Scope.BUILD, "build")
async def post_map(
    request: Request,
    uploads: UploadPartsDep,
    builds: BuildPartsDep,
    caller: CallerDep,
    idempotency_key: Annotated[
        str | None,
        Header(min_length=1, max_length=255, pattern="^[\\x21-\\x7e]+$", description=IDEMPOTENCY_KEY_TEXT),
    ] = None,
) -> Response:
    """Submit a map. It is built into a new version, which then becomes the active one.

    429 `quota_exceeded`: too many builds of the caller wait or run, or its build time of today is used up.
    """
    build_id = new_build_id()
    key = None if idempotency_key is None else CallersKey(caller.repeats_as, idempotency_key)
    async with (
        _within_quota(builds, caller, build_id, key),
        _received(request, uploads, caller) as submission,
    ):
        if key is not None:
            fingerprint = await COPIES.run(submission.fingerprint)
            build_id = await COPIES.run(claim_build, uploads.store, key, fingerprint, build_id)
        await COPIES.run(_record, uploads, builds, build_id, submission, key is not None)
    if builds.queue is not None:
        await builds.queue.submit(build_id)
    status = await READS.run(builds.catalog.builds.status, build_id)
    headers = {"Location": f"/builds/{build_id}", "Retry-After": str(RETRY_AFTER_S)}
    shown = {"build_id": build_id, **status, "waits_for": waits_for(builds.queue, status["state"])}
    return JSONResponse(shown, 202, headers)


@router.get("")
@needs(Scope.LOCALIZE)
@LISTS.route
def get_maps(
    catalog: CatalogDep, caller: CallerDep, limit: Limit = DEFAULT_LIMIT, after: After = None
) -> MapPage:
    """The caller's maps that have a version, sorted by id."""
    found: list[dict[str, Any]] = []
    for map_id in catalog.store.folders("maps"):
        if not is_name(map_id) or map_id <= (after or "") or not caller.sees(map_id):
            continue
        state = catalog.state(map_id)
        if state.published:
            if len(found) == limit:
                return MapPage.model_validate({"maps": found, "next": found[-1]["map_id"]})
            found.append(map_summary(map_id, state))
    return MapPage.model_validate({"maps": found, "next": None})


@router.get("/{map_id}", response_model=MapDetails, response_model_exclude_unset=True)
@needs(Scope.LOCALIZE)
@READS.route
def get_map(map_id: MapId, catalog: CatalogDep, caller: CallerDep) -> dict[str, Any]:
    """One map, with the manifest of its active version."""
    return map_details(catalog, map_id, caller.sees_who)


@router.delete("/{map_id}")
@needs(Scope.ADMIN, "change")
@CHANGES.route
def delete_map(map_id: MapId, catalog: CatalogDep) -> MapRemoval:
    """Take all versions of a map out of service, so that the map is no longer listed.

    Replicas stop answering within their poll interval. The next garbage collection removes the files. A build
    of the map that ends later publishes the map again: cancel it first.
    """
    return MapRemoval(map_id=map_id, retired=catalog.remove_map(map_id))


@asynccontextmanager
async def _within_quota(
    builds: BuildParts, caller: Principal, build_id: str, key: CallersKey | None
) -> AsyncIterator[None]:
    """Count the build against the caller's quota, before anything of a form is read.

    A repeated request, whose build is recorded already, does not count.
    """
    if key is not None and await READS.run(_is_repeated, builds.catalog, key):
        yield
        return
    async with builds.quota.reserve(caller.name, build_id):
        yield


@asynccontextmanager
async def _received(request: Request, parts: UploadParts, caller: Principal) -> AsyncIterator[Submission]:
    """The request's submission. Files of a form are on this disk until the block ends."""
    media_type = request.headers.get("content-type", "").split(";", 1)[0].strip().lower()
    if media_type == "application/json":
        submission = await from_json(request, parts, caller)
        with parts.streams.request(caller.name) if submission.copies_uploads else nullcontext():
            yield submission
    elif media_type == "multipart/form-data":
        declared_bytes = checked_length(request, parts.max_bytes)
        with parts.streams.request(caller.name):
            async with form_directory(parts, declared_bytes) as directory:
                yield await from_form(request, parts, caller, directory)
    else:
        raise UnsupportedFormat("POST /maps accepts multipart/form-data or application/json")


def _record(
    uploads: UploadParts, builds: BuildParts, build_id: str, submission: Submission, repeated: bool
) -> None:
    """Store the files, then the build's record. A repeated request may find the record there."""
    record = _on_record(builds.catalog, build_id) if repeated else None
    if record is None:
        record = submission.keep(uploads)
        builds.usage.begin(submission.caller.name, build_id)
        try:
            builds.catalog.builds.put(build_id, with_traceparent(record))
        except Conflict:  # by the same request at the same time
            if not repeated:
                raise
    keep_for_good(uploads, build_id, record, submission)


def _is_repeated(catalog: Catalog, key: CallersKey) -> bool:
    build_id = claimed_build(catalog.store, key)
    return build_id is not None and _on_record(catalog, build_id) is not None


def _on_record(catalog: Catalog, build_id: str) -> dict[str, Any] | None:
    try:
        return catalog.builds.request(build_id)
    except NotFound:
        return None
