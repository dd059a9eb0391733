"""/maps/{map_id}/versions/{version}/cloud: the map's points in levels of detail, for viewers."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from firstfix.access.permissions import Scope
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_INTENSITY, CLOUD_POINTS
from firstfix.catalog.viewer_cloud import MAX_INDEX_BYTES, POINT
from firstfix.errors import NotFound
from firstfix_service.http_api.edge import needs
from firstfix_service.http_api.parts import CatalogDep
from firstfix_service.http_api.response_budget import ResponseLease, ResponseLeaseDep
from firstfix_service.http_api.routes.versions import kept_for
from firstfix_service.http_api.schema.api_models import CloudIndex
from firstfix_service.http_api.schema.bodies import binary_answer
from firstfix_service.http_api.schema.parameters import MapId, Version
from firstfix_service.thread_pools import LISTS

router = APIRouter(prefix="/maps/{map_id}/versions/{version}/cloud", tags=["versions"])
MAX_POINTS = 500_000  # of one request
First = Annotated[int, Query(ge=0, description="number of the first point")]
Count = Annotated[int, Query(ge=1, le=MAX_POINTS, description="number of points")]


@router.get(
    "",
    response_class=Response,
    responses={200: {"model": CloudIndex}},
)
@needs(Scope.LOCALIZE, "localize")
@LISTS.route
def get_cloud(map_id: MapId, version: Version, catalog: CatalogDep, lease: ResponseLeaseDep) -> Response:
    """The nodes of the octree that holds the map's points.

    `low_m` and `edge_m`: low corner and edge of the root, in map coordinates. `nodes`: `[level, x, y, z,
    first, count]`, parents before children; the edge of a cube is `edge_m / 2**level`, its low corner is
    `low_m + (x, y, z) * edge`. `marks`: `[first, count]` of the templates and of the mapping run, packed as
    points of the root. 404: the version is provisional.
    """
    given, version = version, catalog.full_version(map_id, version)
    entry = catalog.manifest(map_id, version).files.get(CLOUD_INDEX)
    if entry is None:
        raise NotFound(f"version {version} of map {map_id} has no cloud for viewers")
    lease.take(min(entry.bytes, MAX_INDEX_BYTES))
    data = catalog.read_file(map_id, version, CLOUD_INDEX, max_bytes=MAX_INDEX_BYTES)
    return Response(data, media_type="application/json", headers={"Cache-Control": kept_for(given, version)})


@router.get(
    "/points",
    response_class=Response,
    responses=binary_answer("application/octet-stream"),
)
@needs(Scope.LOCALIZE, "localize")
@LISTS.route
def get_cloud_points(
    map_id: MapId,
    version: Version,
    catalog: CatalogDep,
    lease: ResponseLeaseDep,
    first: First,
    count: Count,
) -> Response:
    """Some of the points, 8 bytes each: x, y, z as uint16 in 1/65535 of the node's edge, then the normal.

    Little-endian. The normal is two int8: the octahedral map of a unit vector to -127..127, or twice -128
    where it is not known.
    """
    return _part(
        map_id, version, catalog, lease, CLOUD_POINTS, first * POINT.itemsize, count * POINT.itemsize
    )


@router.get(
    "/intensity",
    response_class=Response,
    responses=binary_answer("application/octet-stream"),
)
@needs(Scope.LOCALIZE, "localize")
@LISTS.route
def get_cloud_intensity(
    map_id: MapId,
    version: Version,
    catalog: CatalogDep,
    lease: ResponseLeaseDep,
    first: First,
    count: Count,
) -> Response:
    """The intensity of some of the points, a byte each. 404: the index of the cloud tells of none."""
    return _part(map_id, version, catalog, lease, CLOUD_INTENSITY, first, count)


def _part(
    map_id: str, version: str, catalog: Catalog, lease: ResponseLease, file: str, start: int, length: int
) -> Response:
    given, version = version, catalog.full_version(map_id, version)
    lease.take(length)
    data = catalog.read_part(map_id, version, file, start, length)
    return Response(
        data, media_type="application/octet-stream", headers={"Cache-Control": kept_for(given, version)}
    )
