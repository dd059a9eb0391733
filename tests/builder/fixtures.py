"""Fixtures of the tests of builds: a build that is queued, and queries of robots that are kept."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery, new_query_id
from firstfix.catalog.sources import put_source

XYZ = "application/vnd.firstfix.xyz"


def uploaded(catalog: Catalog, content: bytes, folder: Path) -> dict[str, str]:
    """A source of the map "hall", as a build's request names it."""
    (folder / "upload").write_bytes(content)
    return {"key": f"maps/hall/sources/{put_source(catalog.store, 'hall', folder / 'upload')}"}


def queue_build(catalog: Catalog, folder: Path, build_id: str = "b1", **request: Any) -> None:
    """Records the request of a build of the map "hall", with a source."""
    source = uploaded(catalog, b"a cloud", folder)
    given = {"map_id": "hall", "source": source, "file_name": "hall.ply", "trajectory": None, "config": {}}
    catalog.builds.put(build_id, given | request)


def record_query(
    recorded_queries: RecordedQueries,
    time: datetime,
    answer: Mapping[str, Any],
    body: bytes,
    *,
    robot: str = "ann",
    map_id: str = "hall",
    options: Mapping[str, str] | None = None,
) -> str:
    """Records a query of points in the service's plain form. Returns its id."""
    query_id = new_query_id(f"{len(recorded_queries.ids()):08x}", time)
    said, given = dict(answer), dict(options or {})
    recorded = RecordedQuery(
        query_id, time.isoformat(), "http", "r", "", map_id, XYZ, "", given, said, len(body), robot=robot
    )
    recorded_queries.put(recorded, body)
    return query_id
