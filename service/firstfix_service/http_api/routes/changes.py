"""/maps/{map_id}/changes: where the queries show that a map is out of date."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query

from firstfix.access.permissions import Scope
from firstfix.catalog.sightings.changes import changes_of
from firstfix.errors import NotFound

from ...thread_pools import LISTS
from ..edge import needs
from ..parts import MapPartsDep
from ..schema.changes_model import MapChanges
from ..schema.parameters import DEFAULT_LIMIT, Limit, MapId

router = APIRouter(prefix="/maps/{map_id}", tags=["maps"])


@router.get("/changes", response_model=MapChanges, response_model_exclude_unset=True)
@needs(Scope.LOCALIZE, "localize")
@LISTS.route
def get_changes(
    map_id: MapId,
    parts: MapPartsDep,
    version: Annotated[
        str | None,
        Query(description="default: the active version", json_schema_extra={"pattern": "^[0-9a-f]{64}$"}),
    ] = None,
    limit: Limit = DEFAULT_LIMIT,
    cells: Annotated[bool, Query(description="with the cells of each area")] = False,
    grid: Annotated[bool, Query(description="with the counts of all cells, up to 50,000 of them")] = False,
) -> dict[str, Any]:
    """Areas that have changed since the map was made, as the localized queries of all replicas show it.

    `gone`: queries see through surfaces of the map. `new`: queries see something where the map has nothing,
    in front of its surfaces. The largest areas come first.
    """
    wanted = version or parts.catalog.active_version(map_id)
    if wanted is None:
        raise NotFound(f"map {map_id} has no active version")
    record = parts.sightings.read(map_id, wanted)
    found = changes_of(record, limit=limit, with_cells=cells, with_grid=grid)
    return {"map_id": map_id, "version": wanted, **found}
