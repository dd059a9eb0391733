"""A map with recorded queries as a file for viewers: Foxglove, RViz and rerun."""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, Field

from firstfix.access.permissions import Scope
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import CLOUD_INDEX
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.errors import InvalidOption, NotFound, TooLarge
from firstfix_service.http_api.edge import CallerDep, needs
from firstfix_service.http_api.parts import CatalogDep, RecordedQueriesDep
from firstfix_service.http_api.response_budget import ResponseLeaseDep
from firstfix_service.http_api.schema.bodies import binary_answer
from firstfix_service.http_api.schema.parameters import MapId, Version
from firstfix_service.thread_pools import ThreadPool

from .export.export import write_viewer_file
from .export.exported_query import ExportedQuery
from .export.rrd_file import NEEDS_RERUN
from .export.source import StoredMap

router = APIRouter(tags=["versions"])
Format = Literal["mcap", "rrd"]
MAX_POINTS = 2_000_000  # of the map
MAX_QUERIES = 100
MAX_BYTES = 64 << 20  # of the file, so that the map has room
POINT_BYTES = 20  # of the map, with intensity and, in an .rrd, colour
FORMATS: dict[Format, str] = {"mcap": "Foxglove, RViz, rerun and ros2 bag", "rrd": "rerun"}
EXPORTS = ThreadPool("exports", 1, 10.0)  # each takes some seconds of a processor


class ViewerFormat(BaseModel):
    """A form of file for viewers."""

    format: Format
    opened_by: str
    remedy: str = Field(description="what to install where this service cannot write it; else empty")


@router.get("/viewer-formats")
@needs(Scope.LOCALIZE)
async def get_viewer_formats() -> list[ViewerFormat]:
    """The files for viewers that this service writes, and what is missing for others."""
    return [ViewerFormat(format=one, opened_by=FORMATS[one], remedy=_remedy(one)) for one in FORMATS]


@router.get(
    "/maps/{map_id}/versions/{version}/viewer-file",
    response_class=Response,
    responses=binary_answer("application/octet-stream"),
)
@needs(Scope.LOCALIZE, "localize")
@EXPORTS.route
def get_viewer_file(
    map_id: MapId,
    version: Version,
    catalog: CatalogDep,
    recorded_queries: RecordedQueriesDep,
    lease: ResponseLeaseDep,
    caller: CallerDep,
    form: Annotated[
        Format, Query(alias="format", description="`mcap`: Foxglove, RViz, rerun, ros2 bag; `rrd`: rerun")
    ] = "mcap",
    points: Annotated[int, Query(ge=1, le=MAX_POINTS, description="limit on the map's points")] = MAX_POINTS,
    queries: Annotated[
        int,
        Query(
            ge=0, le=MAX_QUERIES, description="the newest so many recorded queries; needs the scope `build`"
        ),
    ] = 0,
) -> Response:
    """A version's points, its templates and the mapping run, with recorded queries at their poses.

    404: the version has no cloud for viewers. 413: the file would have over 64 MiB; `firstfix export` has no
    such limit.
    """
    if queries:
        caller.check(Scope.BUILD)
    if remedy := _remedy(form):
        raise InvalidOption(remedy)
    version = catalog.full_version(map_id, version)
    if CLOUD_INDEX not in catalog.manifest(map_id, version).files:
        raise NotFound(f"version {version} of map {map_id} has no cloud for viewers")
    lease.take(MAX_BYTES)
    data = _written(catalog, recorded_queries, map_id, version, form, points, queries)
    name = f"{map_id}-{version[:12]}.{form}"
    headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
    return Response(data, media_type="application/octet-stream", headers=headers)


def _written(
    catalog: Catalog,
    recorded_queries: RecordedQueries,
    map_id: str,
    version: str,
    form: str,
    points: int,
    queries: int,
) -> bytes:
    left = MAX_BYTES - POINT_BYTES * points

    def room(query: ExportedQuery) -> None:
        nonlocal left
        left -= query.points.nbytes
        if left < 0:
            raise TooLarge(
                f"the file would have over {MAX_BYTES >> 20} MiB: ask for fewer points or queries, or take "
                f"`firstfix export {map_id}.{form} --map {map_id}`"
            )

    with tempfile.TemporaryDirectory(prefix="firstfix-viewer-file-") as name:
        folder = Path(name)
        source = StoredMap(catalog, recorded_queries, map_id)
        write_viewer_file(source, map_id, version, folder, f".{form}", points, queries, room)
        return (folder / "out").read_bytes()


def _remedy(form: Format) -> str:
    if form == "rrd" and find_spec("rerun") is None:
        return NEEDS_RERUN
    return ""
