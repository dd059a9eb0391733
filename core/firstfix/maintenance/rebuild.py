"""Rebuild of a map from its sources, for a release with another format of versions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..catalog.catalog import Catalog
from ..catalog.log.map_state import Event
from ..errors import NotFound, VersionError
from ..ids import new_build_id
from ..store.store import CHUNK_BYTES, Store
from .pending_deletions import is_deletion_pending


def rebuild(catalog: Catalog, map_id: str, *, exact: bool = False) -> str:
    """Record a build that repeats the one of the map's active version, whatever its format.

    The build workers of the store find it there. Patches are not repeated: a version of another format cannot
    be read, and the queries that confirmed them may be gone. It keeps learned keys and calibration of the
    same version as that one did.

    Args:
        exact: keep nothing of any version.

    Returns:
        Id of the new build.

    Raises:
        NotFound: no such map; or it must be submitted again, because its active version was built without a
            record, or its sources are gone.
        InvalidOption: the map id is invalid.
        StoreError: the store failed.
    """
    version, request = active_request(catalog, map_id)
    request.pop("patch", None)
    base = None if exact else _base_of(catalog, map_id, version)
    upon = {"exact": True} if base is None else {"base": base}
    config = {**(request.get("config") or {}), **upon}
    return record_again(
        catalog, map_id, {**request, "config": config, "command": f"rebuild of version {version}"}
    )


def _base_of(catalog: Catalog, map_id: str, version: str) -> str | None:
    """The version of which a version keeps keys and calibration; None: of none, or it cannot be read."""
    try:
        base = catalog.manifest(map_id, version).config.get("base")
    except (NotFound, VersionError):
        return None
    return None if base is None else str(base)


def active_request(catalog: Catalog, map_id: str) -> tuple[str, dict[str, Any]]:
    """The active version of a map, and the request of the build that made it, without its caller.

    Raises:
        NotFound: as ``rebuild``.
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
        raise NotFound(f"the active version of map {map_id} was built without a record: submit the map again")
    request = catalog.builds.request(made_by)
    _check_files(catalog.store, map_id, request)
    for name in ("traceparent", "owner"):  # of the old request and its caller
        request.pop(name, None)
    return state.active, request


def record_again(catalog: Catalog, map_id: str, request: Mapping[str, Any], build_id: str = "") -> str:
    """Record a build with the sources of an earlier request. Returns its id.

    Args:
        build_id: empty: a new one.

    Raises:
        NotFound: a source is gone.
    """
    build_id = build_id or new_build_id()
    catalog.builds.put(build_id, request)
    # As for a submitted map. If a source has just been removed, the build fails and this error says why.
    _check_files(catalog.store, map_id, request, own_copy_for=build_id)
    return build_id


def _check_files(store: Store, map_id: str, request: Mapping[str, Any], *, own_copy_for: str = "") -> None:
    """Check that the sources of a request are there.

    Args:
        own_copy_for: recorded build that gets its own copy of a source if its deletion is pending.

    Raises:
        NotFound: a source is gone.
    """
    for role in ("source", "trajectory"):
        named = request.get(role)
        if not named or "key" not in named:
            continue
        key = str(named["key"])
        try:
            # before the size, because the source may be deleted in between
            needs_copy = bool(own_copy_for) and is_deletion_pending(store, key)
            size = store.size(key)
            if needs_copy:
                pieces = (store.get_range(key, start, CHUNK_BYTES) for start in range(0, size, CHUNK_BYTES))
                store.put_pieces(f"{key}.{own_copy_for}", pieces)
        except NotFound:
            raise NotFound(f"the {role} of map {map_id} is gone: submit the map again") from None
