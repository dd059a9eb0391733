"""A map with recorded queries as a file for viewers: Foxglove, RViz and rerun."""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field

from firstfix.access.permissions import Scope
from firstfix.catalog.manifest import CLOUD_INDEX
from firstfix.catalog.recorded_queries import RecordedQuery
from firstfix.errors import InputError, InvalidOption, NotFound, TooLarge
from firstfix_service.auth.principal import Principal
from firstfix_service.http_api.edge import CallerDep, needs
from firstfix_service.http_api.gone import cancel_when_gone
from firstfix_service.http_api.parts import CatalogDep, LocalizeParts, LocalizePartsDep, RecordedQueriesDep
from firstfix_service.http_api.response_budget import ResponseLeaseDep
from firstfix_service.http_api.schema.bodies import binary_answer
from firstfix_service.http_api.schema.parameters import MapId, Version
from firstfix_service.query_workers.look import Look
from firstfix_service.query_workers.query import BodyFormat
from firstfix_service.thread_pools import ThreadPool

from .export.export import write_viewer_file
from .export.exported_query import exported_queries
from .export.rrd_file import NEEDS_RERUN
from .export.shown_scan import NO_POINTS, ShownScan, shown
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
async def get_viewer_file(
    request: Request,
    map_id: MapId,
    version: Version,
    catalog: CatalogDep,
    recorded_queries: RecordedQueriesDep,
    parts: LocalizePartsDep,
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
    source = StoredMap(catalog, recorded_queries, map_id)

    def find() -> tuple[str, list[RecordedQuery]]:
        whole = catalog.full_version(map_id, version)
        if CLOUD_INDEX not in catalog.manifest(map_id, whole).files:
            raise NotFound(f"version {whole} of map {map_id} has no cloud for viewers")
        return whole, list(islice(source.recorded_queries(), queries))

    whole, recorded = await EXPORTS.run(find)
    lease.take(MAX_BYTES + max((one.body_bytes for one in recorded), default=0))
    scans: dict[str, ShownScan] = {}
    left = MAX_BYTES - POINT_BYTES * points
    for one in recorded:
        scan = await cancel_when_gone(request.scope, _scan_of(parts, caller, source, one))
        left -= scan.points.nbytes
        if left < 0:
            raise TooLarge(
                f"the file would have over {MAX_BYTES >> 20} MiB: ask for fewer points or queries, or take "
                f"`firstfix export {map_id}.{form} --map {map_id}`"
            )
        scans[one.query_id] = scan

    def write() -> bytes:
        # each scan goes out of memory once it is written
        exported = exported_queries(recorded, map_id, lambda one: scans.pop(one.query_id))
        with tempfile.TemporaryDirectory(prefix="firstfix-viewer-file-") as name:
            folder = Path(name)
            write_viewer_file(source, map_id, whole, folder, f".{form}", points, exported)
            return (folder / "out").read_bytes()

    data = await EXPORTS.run(write)
    name = f"{map_id}-{whole[:12]}.{form}"
    headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
    return Response(data, media_type="application/octet-stream", headers=headers)


async def _scan_of(
    parts: LocalizeParts, caller: Principal, source: StoredMap, recorded: RecordedQuery
) -> ShownScan:
    """The scan of a recorded query, which a worker process decodes in its turn, as that of a query."""
    try:
        body_format = BodyFormat.of(recorded.media_type, recorded.content_encoding)
        look = Look(caller.name, body_format, shown)
        parts.use_case.check_room(look)
        body = await EXPORTS.run(source.body, recorded.query_id)
        return ShownScan.unpacked(await parts.use_case.look(look, body))
    except (InputError, NotFound) as error:
        return ShownScan(NO_POINTS, unreadable=str(error))


def _remedy(form: Format) -> str:
    if form == "rrd" and find_spec("rerun") is None:
        return NEEDS_RERUN
    return ""
