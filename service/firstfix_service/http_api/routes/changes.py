"""/maps/{map_id}/changes: where the queries show that a map is out of date."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from firstfix.access.permissions import Scope
from firstfix.errors import NotFound

from ...thread_pools import LISTS
from ..edge import needs
from ..encoded_changes import EncodedChanges
from ..parts import MapPartsDep
from ..schema.changes import MapChanges
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
        Query(
            description="or its first characters, 4 or more; default: the active version",
            json_schema_extra={"pattern": "^[0-9a-f]{4,64}$"},
        ),
    ] = None,
    limit: Limit = DEFAULT_LIMIT,
    cells: Annotated[bool, Query(description="with the cells of each area")] = False,
    grid: Annotated[bool, Query(description="with the counts of all cells, up to 50,000 of them")] = False,
) -> Response:
    """Areas that have changed since the map was made, as the localized queries of all replicas show it.

    `gone`: queries see through surfaces of the map. `new`: queries see something where the map has nothing,
    in front of its surfaces. `unmapped`: so they do, but the mapping run never saw the place: the map lacks a
    part, and nobody knows of a change. The largest areas come first, the unmapped ones after the others.
    """
    catalog = parts.catalog
    wanted = catalog.full_version(map_id, version) if version else catalog.active_version(map_id)
    if wanted is None:
        raise NotFound(f"map {map_id} has no active version")

    def make() -> EncodedChanges:
        return EncodedChanges.of(map_id, wanted, parts.sightings.read(map_id, wanted))

    state = parts.sightings.state(map_id, wanted)
    made = parts.changes.of((map_id, wanted), state, make)
    return Response(made.json(limit, with_cells=cells, with_grid=grid), media_type="application/json")
