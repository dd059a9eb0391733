"""A map built once more, from the files that were handed in: when a release has another format."""

from __future__ import annotations

from .catalog import Catalog
from .errors import NotFound
from .ids import new_build_id
from .map_state import Event


def rebuild(catalog: Catalog, map_id: str) -> str:
    """Puts a build on record that does again what made the map's active version, whatever its format.

    Whoever runs the builds of the store finds it there.

    Returns:
        the new build's id.

    Raises:
        NotFound: no such map; or it has to be handed in again, as its active version was made without a
            record or its files are gone.
        InvalidOption: the id is none.
        StoreError: as the store.
    """
    state = catalog.state(map_id)
    if state.active is None:
        raise NotFound(f"map {map_id} has no active version")
    made_by = next(
        entry.build_id
        for entry in reversed(state.entries)
        if (entry.event, entry.version) == (Event.PUBLISHED, state.active)
    )
    if not made_by:
        raise NotFound(
            f"the active version of map {map_id} was built without a record: hand the map in again"
        )
    request = catalog.build_request(made_by)
    for role in ("source", "trajectory"):
        named = request.get(role)
        if named and "key" in named and not catalog.store.exists(named["key"]):
            raise NotFound(f"the {role} of map {map_id} is gone: hand the map in again")
    request.pop("traceparent", None)  # of a request long ago
    build_id = new_build_id()
    catalog.put_build(build_id, request)
    return build_id
