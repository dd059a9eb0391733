"""/maps/{map_id}/versions/{version}/thumbnail: a small picture of a map from above, in the page's colours."""

from __future__ import annotations

import struct
import zlib
from functools import lru_cache
from typing import Any

import numpy as np
import orjson
from fastapi import APIRouter, Response
from numpy.typing import NDArray

from firstfix.access.permissions import Scope
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_POINTS
from firstfix.catalog.viewer_cloud import MAX_INDEX_BYTES, NO_NORMAL, POINT
from firstfix.errors import CorruptVersion, NotFound
from firstfix_service.http_api.edge import needs
from firstfix_service.http_api.parts import CatalogDep
from firstfix_service.http_api.routes.versions import kept_for
from firstfix_service.http_api.schema.bodies import binary_answer
from firstfix_service.http_api.schema.parameters import MapId, Version
from firstfix_service.thread_pools import PICTURES

router = APIRouter(prefix="/maps/{map_id}/versions/{version}/thumbnail", tags=["versions"])
WIDTH_PX, HEIGHT_PX = 192, 128
KEPT = 500  # pictures in memory, some kilobytes each
MAX_DRAWN = 200_000  # points of the root
STRAYS = 0.5  # percent on each side of an axis: seen through a window, or made by a mirror
MARGIN = 1.05
MAX_REACH_PX = 3  # of a point to each side
GROUND = (16, 22, 27)  # as ``--picture-ground`` of the page
# Turbo (Mikhailov 2019), from low to high, as the page's legend has it.
TURBO = np.array(
    [(61, 79, 196), (63, 142, 247), (28, 198, 213), (51, 236, 147), (143, 252, 78)]
    + [(212, 231, 53), (253, 176, 50), (242, 96, 20), (195, 37, 3), (142, 13, 1)],
    np.float64,
)


@router.get("", response_class=Response, responses=binary_answer("image/png"))
@needs(Scope.LOCALIZE, "localize")
@PICTURES.route
def get_thumbnail(map_id: MapId, version: Version, catalog: CatalogDep) -> Response:
    """The version's map from above, 192 x 128 pixels, coloured by height on a dark ground.

    404: the version is provisional.
    """
    given, version = version, catalog.full_version(map_id, version)
    picture = _kept(catalog, map_id, version)
    return Response(picture, media_type="image/png", headers={"Cache-Control": kept_for(given, version)})


@lru_cache(KEPT)
def _kept(catalog: Catalog, map_id: str, version: str) -> bytes:
    if CLOUD_INDEX not in catalog.manifest(map_id, version).files:
        raise NotFound(f"version {version} of map {map_id} has no cloud for viewers")
    index = orjson.loads(catalog.read_file(map_id, version, CLOUD_INDEX, max_bytes=MAX_INDEX_BYTES))
    first, count = _root_of(index)
    packed = catalog.read_part(
        map_id, version, CLOUD_POINTS, first * POINT.itemsize, min(count, MAX_DRAWN) * POINT.itemsize
    )
    return png(drawn(np.frombuffer(packed, POINT)))


def _root_of(index: Any) -> tuple[int, int]:
    """First point and number of points of the root, which is spread evenly over the whole map."""
    try:
        level, *_, first, count = (int(value) for value in index["nodes"][0])
        if level == 0 and first >= 0 and count > 0:
            return first, count
    except (LookupError, TypeError, ValueError):
        pass
    raise CorruptVersion("the cloud of the version has no root")


def drawn(points: NDArray[np.void]) -> NDArray[np.uint8]:
    """Draw packed points from above, without what looks down, such as ceilings.

    Returns:
        (HEIGHT_PX, WIDTH_PX, 3) colours, north (y) up, with the highest point of each pixel.
    """
    at = points["at"].astype(np.float64)  # (n, 3)
    bend = points["normal"].astype(int)
    # the octahedral map: beyond this sum of the two, the normal looks down by more than 53 degrees
    looks_down = (np.abs(bend).sum(axis=1) > 1.6 * 127) & (bend[:, 0] != NO_NORMAL)
    at = at[~looks_down] if not looks_down.all() else at
    low, high = np.percentile(at, [STRAYS, 100 - STRAYS], axis=0)
    size = np.maximum(high - low, 1.0)
    scale = min(WIDTH_PX / size[0], HEIGHT_PX / size[1]) / MARGIN
    middle = (low + high) / 2
    column = np.round((at[:, 0] - middle[0]) * scale + (WIDTH_PX - 1) / 2).astype(int)
    row = np.round((middle[1] - at[:, 1]) * scale + (HEIGHT_PX - 1) / 2).astype(int)
    inside = (column >= 0) & (column < WIDTH_PX) & (row >= 0) & (row < HEIGHT_PX)
    heights = np.full((HEIGHT_PX, WIDTH_PX), -np.inf)
    np.maximum.at(heights, (row[inside], column[inside]), at[inside, 2])
    heights = _closed(heights, apart_px=scale * np.sqrt(size[0] * size[1] / len(at)))
    share = np.clip((heights - low[2]) / size[2], 0, 1) * (len(TURBO) - 1)
    colours = np.stack([np.interp(share, np.arange(len(TURBO)), TURBO[:, i]) for i in range(3)], axis=2)
    return np.where(np.isinf(heights)[..., None], GROUND, colours).astype(np.uint8)


def _closed(heights: NDArray[np.float64], apart_px: float) -> NDArray[np.float64]:
    """The heights with each point as large as the distance to the next one, so that a floor has no holes."""
    reach = min(int(np.ceil(apart_px / 2)), MAX_REACH_PX)
    padded = np.pad(heights, reach, constant_values=-np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(windows.max(axis=(2, 3)))


def png(picture: NDArray[np.uint8]) -> bytes:
    """Encode (h, w, 3) colours as PNG (RFC 2083), lossless."""
    height, width, _ = picture.shape
    rows = np.zeros((height, 1 + 3 * width), np.uint8)  # each row behind a 0: no filter
    rows[:, 1:] = picture.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(map(_chunk, parts))


def _chunk(part: tuple[bytes, bytes]) -> bytes:
    kind, data = part
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
