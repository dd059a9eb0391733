"""A map built once more, from the files that were handed in: when a release has another format."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..catalog.catalog import Catalog
from ..catalog.log.map_state import Event
from ..errors import NotFound
from ..ids import new_build_id
from ..store.store import CHUNK_BYTES, Store
from .pending_deletions import is_deletion_pending


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
    _check_files(catalog.store, map_id, request)
    for name in ("traceparent", "owner"):  # of a request long ago, and of who made that
        request.pop(name, None)
    build_id = new_build_id()
    catalog.put_build(build_id, request)
    # As for a map that is handed in; where a file has just gone, the build fails and this says why.
    _check_files(catalog.store, map_id, request, own_copy_for=build_id)
    return build_id


def _check_files(store: Store, map_id: str, request: Mapping[str, Any], *, own_copy_for: str = "") -> None:
    """
    Args:
        own_copy_for: a build that is on record, and gets a copy of what somebody is about to remove.

    Raises:
        NotFound: a file that the request names is gone.
    """
    for role in ("source", "trajectory"):
        named = request.get(role)
        if not named or "key" not in named:
            continue
        key = str(named["key"])
        try:
            doomed = bool(own_copy_for) and is_deletion_pending(store, key)  # before the size: it may go in between
            size = store.size(key)
            if doomed:
                pieces = (store.get_range(key, start, CHUNK_BYTES) for start in range(0, size, CHUNK_BYTES))
                store.put_pieces(f"{key}.{own_copy_for}", pieces)
        except NotFound:
            raise NotFound(f"the {role} of map {map_id} is gone: hand the map in again") from None
