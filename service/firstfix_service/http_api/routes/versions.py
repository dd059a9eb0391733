"""/maps/{map_id}/versions: versions of a map, their reports, and which version is active."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response

from firstfix.access.permissions import Scope
from firstfix.catalog.described import version_details, version_summary
from firstfix.catalog.version_findings import findings_of
from firstfix.errors import NotFound

from ...thread_pools import CHANGES, LISTS, READS
from ..edge import CallerDep, needs
from ..parts import CatalogDep, MapPartsDep
from ..response_budget import ResponseLeaseDep
from ..schema.api_models import Activation, Retirement, VersionDetails, VersionPage
from ..schema.bodies import BINARY
from ..schema.parameters import DEFAULT_LIMIT, After, Limit, MapId, Version
from ..schema.version_report import VersionReport
from ..static_page import FOREVER

router = APIRouter(prefix="/maps/{map_id}", tags=["versions"])
PICTURES = ("preview", "reliability", "localizability")
MAX_PICTURE_BYTES = 64 << 20
_PICTURE: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {"image/png": BINARY},
        "headers": {"ETag": {"description": "sha256 of the picture", "schema": {"type": "string"}}},
    },
    304: {"description": "not modified"},
}


@router.get("/versions")
@needs(Scope.LOCALIZE)
@READS.route
def get_versions(
    map_id: MapId,
    catalog: CatalogDep,
    caller: CallerDep,
    limit: Limit = DEFAULT_LIMIT,
    after: After = None,
) -> VersionPage:
    """Published versions of the map, newest first, with what they were made of.

    Who made a version, where and by which command is for callers with the scope `admin`, and for who made it.
    """
    infos = catalog.versions(map_id)
    if after is not None:
        names = [info.version for info in infos]
        if after not in names:
            raise NotFound(f"map {map_id} has no version {after[:64]} (after)")
        infos = infos[names.index(after) + 1 :]
    page = [version_summary(info, caller.sees_who) for info in infos[:limit]]
    following = page[-1]["version"] if len(infos) > limit else None
    return VersionPage.model_validate({"map_id": map_id, "versions": page, "next": following})


@router.get("/versions/{version}", response_model=VersionDetails)
@needs(Scope.LOCALIZE)
@READS.route
def get_version(map_id: MapId, version: Version, catalog: CatalogDep, caller: CallerDep) -> dict[str, Any]:
    """One version, with its manifest."""
    return version_details(catalog, map_id, catalog.full_version(map_id, version), caller.sees_who)


@router.get("/versions/{version}/report", response_model=VersionReport)
@needs(Scope.LOCALIZE)
@READS.route
def get_report(map_id: MapId, version: Version, catalog: CatalogDep) -> dict[str, Any]:
    """Results of the build's self-test.

    Success rate, reliability of the probabilities, and localizability: where a robot can find itself.
    """
    version = catalog.full_version(map_id, version)
    manifest = catalog.manifest(map_id, version)
    return {
        "map_id": map_id,
        "version": version,
        "counts": manifest.counts,
        "sensor": manifest.sensor,
        "bounds": manifest.bounds,
        "self_test": manifest.self_test,
        "findings": [one.to_mapping() for one in findings_of(manifest)],
        "rebuilt": manifest.source.get("rebuilt"),
        "pictures": [name for name in PICTURES if f"{name}.png" in manifest.files],
    }


@router.get("/versions/{version}/preview", response_class=Response, responses=_PICTURE)
@router.get("/versions/{version}/reliability", response_class=Response, responses=_PICTURE)
@router.get("/versions/{version}/localizability", response_class=Response, responses=_PICTURE)
@needs(Scope.LOCALIZE, "localize")
@LISTS.route
def get_picture(
    map_id: MapId,
    version: Version,
    request: Request,
    catalog: CatalogDep,
    lease: ResponseLeaseDep,
    if_none_match: Annotated[str | None, Header(description="ETags of the caller's copies")] = None,
) -> Response:
    """A picture of the version.

    `preview`: the map from above with its templates. `reliability`: predicted and measured probabilities.
    `localizability`: where a robot can find itself.
    """
    given, version = version, catalog.full_version(map_id, version)
    name = f"{request.url.path.rsplit('/', 1)[-1]}.png"
    entry = catalog.manifest(map_id, version).files.get(name)
    if entry is None:
        raise NotFound(f"version {version} of map {map_id} has no {name}")
    headers = {"ETag": f'"{entry.sha256}"', "Cache-Control": kept_for(given, version)}
    if if_none_match is not None and _names(if_none_match, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    lease.take(min(entry.bytes, MAX_PICTURE_BYTES))
    data = catalog.read_file(map_id, version, name, max_bytes=MAX_PICTURE_BYTES)
    return Response(data, media_type="image/png", headers=headers)


@router.post("/versions/{version}/activate")
@needs(Scope.BUILD, "change")
@CHANGES.route
def activate(map_id: MapId, version: Version, parts: MapPartsDep) -> Activation:
    """Make a published version, older or newer, the active one.

    This replica serves it before it answers the request, other replicas within their poll interval.
    """
    version = parts.catalog.full_version(map_id, version)
    parts.catalog.activate(map_id, version)
    serving = parts.maps.refresh(map_id).version
    return Activation(map_id=map_id, active_version=version, serving_version=serving)


@router.post("/rollback")
@needs(Scope.BUILD, "change")
@CHANGES.route
def roll_back(map_id: MapId, parts: MapPartsDep) -> Activation:
    """Make the previously active version the active one. A second call undoes the first.

    409: no version was active before.
    """
    version = parts.catalog.roll_back(map_id)
    serving = parts.maps.refresh(map_id).version
    return Activation(map_id=map_id, active_version=version, serving_version=serving)


@router.delete("/versions/{version}")
@needs(Scope.ADMIN, "change")
@CHANGES.route
def retire(
    map_id: MapId,
    version: Version,
    catalog: CatalogDep,
    force: Annotated[
        bool, Query(description="also retire the active version: the one before it becomes active")
    ] = False,
) -> Retirement:
    """Take a version out of service. The next garbage collection removes its files.

    409: it is the active version, and `force` is not set.
    """
    version = catalog.full_version(map_id, version)
    catalog.retire(map_id, version, force=force)
    return Retirement(map_id=map_id, version=version, active_version=catalog.active_version(map_id))


def kept_for(given: str, version: str) -> str:
    """Cache-Control of what a version holds. First characters may name another version tomorrow."""
    return FOREVER if given == version else "private, no-cache"


def _names(if_none_match: str, etag: str) -> bool:
    given = (item.strip().removeprefix("W/") for item in if_none_match.split(","))
    return any(item in (etag, "*") for item in given)
