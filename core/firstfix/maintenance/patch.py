"""Request of a patch: a build of a map's active version with the changes that recorded queries confirm."""

from __future__ import annotations

import hashlib
from datetime import datetime, timezone
from typing import Any

from ..builds.config import BuildConfig, PatchMode
from ..catalog.catalog import Catalog
from ..catalog.log.map_state import Event
from ..catalog.sightings.sightings import Sightings
from ..engine.changes.areas import find_areas
from ..errors import Conflict, NotFound, UnreadableRecord
from .rebuild import active_request, record_again

MIN_DAYS = 3  # on which the version's queries have looked for changes: a patch needs as many


def patch_request(catalog: Catalog, map_id: str, mode: PatchMode | None = None) -> dict[str, Any]:
    """The request of a build that patches a map.

    Args:
        mode: what becomes of the patched version; None: as the map's build config says.

    Raises:
        NotFound: no such map; or it must be submitted again, because its active version was built without a
            record, or its sources are gone.
        Conflict: patches of this map are off, or its active version is provisional.
    """
    base, request = active_request(catalog, map_id)
    if base in catalog.state(map_id).provisional:
        raise Conflict(f"the active version of map {map_id} is provisional: wait for the full one")
    mode = mode or BuildConfig.parse(request.get("config") or {}).patch
    if mode == "off":
        raise Conflict(
            f"patches of map {map_id} are off: name a mode, propose or activate, or build the map with "
            "patch: propose in its config"
        )
    return {**request, "patch": {"base": base, "mode": mode}}


def request_patch(catalog: Catalog, map_id: str, mode: PatchMode | None = None) -> str:
    """Record a build that patches a map. The build workers of the store find it there. Returns its id.

    Raises:
        NotFound, Conflict: as ``patch_request``.
    """
    return record_again(catalog, map_id, patch_request(catalog, map_id, mode))


def request_due_patches(catalog: Catalog, now: datetime) -> list[str]:
    """Record a patch of each map whose config allows it, whose hour has come, and that seems to have changed.

    Each map has an hour of the day (UTC). The build's id is made of the map, the version and this hour, so
    that several callers record one build a day. Call it more often than once an hour.

    Args:
        now: by the store's clock.

    Returns:
        Ids of the new builds.

    Raises:
        StoreError: the store failed.
    """
    hour = now.astimezone(timezone.utc).replace(minute=0, second=0, microsecond=0)
    due = []
    for map_id in catalog.folder_names():
        if hour_of(map_id) != hour.hour:
            continue
        try:
            request = patch_request(catalog, map_id)
            version = request["patch"]["base"]
            if not is_patch_waiting(catalog, map_id, version) and seems_changed(catalog, map_id, version):
                name = f"{hour:%Y%m%dt%H%M%S}-{_digest(map_id, version)[:8]}"
                due.append(record_again(catalog, map_id, request, name))
        except (Conflict, NotFound, UnreadableRecord):
            continue  # it wants no patch or cannot have one, or another replica was first
    return due


def hour_of(map_id: str) -> int:
    """The hour of the day, 0..23, in which patches of a map are made: the maps share the day."""
    return int(_digest(map_id), 16) % 24


def is_patch_waiting(catalog: Catalog, map_id: str, version: str) -> bool:
    """Whether a patch of the active version is there and not active: it waits, or was rolled back.

    Raises:
        UnreadableRecord: the request of a build is damaged.
    """
    state = catalog.state(map_id)
    made_by = [
        entry.build_id
        for entry in state.entries
        if entry.event is Event.PUBLISHED and entry.version in state.published and entry.version != version
    ]
    return any(_base_of(catalog, build_id) == version for build_id in made_by if build_id)


def _base_of(catalog: Catalog, build_id: str) -> str | None:
    """The version that a build has patched; None: it was no patch, or its record is gone."""
    try:
        patch = catalog.builds.request(build_id).get("patch")
    except NotFound:
        return None
    return str(patch.get("base")) if isinstance(patch, dict) else None


def seems_changed(catalog: Catalog, map_id: str, version: str) -> bool:
    """Whether the queries of a version have seen changes, on enough days for a patch.

    Raises:
        NotFound: no such version.
    """
    record = Sightings(catalog.store).read(catalog.folder_of(map_id, version))
    return len(record.days) >= MIN_DAYS and bool(find_areas(record.newest_first()))


def _digest(*parts: str) -> str:
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()
