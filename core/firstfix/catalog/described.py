"""Maps and versions as JSON for people: the same at the shell, over HTTP and in Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..errors import NotFound
from .catalog import Catalog, VersionInfo, version_info
from .log.map_state import MapState
from .provenance import Provenance

SeesWho = Callable[[Provenance], bool]


def everybody(provenance: Provenance) -> bool:
    """Show who made a version to all: who has the store itself may see it."""
    return True


def version_summary(info: VersionInfo, sees_who: SeesWho = everybody) -> dict[str, Any]:
    """One version in a list.

    Args:
        sees_who: whether the reader may see who made it, and where.
    """
    provenance = info.provenance
    return {
        "version": info.version,
        "active": info.active,
        "published_time": info.published_time,
        "provisional": info.provisional,
        "provenance": provenance.to_mapping(private=sees_who(provenance)),
        "summary": dict(info.summary),
    }


def map_summary(map_id: str, state: MapState) -> dict[str, Any]:
    """One map in a list, with what its log tells of its active version."""
    active = None if state.active is None else version_info(state, state.active)
    return {
        "map_id": map_id,
        "active_version": state.active,
        "published_time": None if active is None else active.published_time,
        "provisional": active is not None and active.provisional,
        "summary": {} if active is None else dict(active.summary),
    }


def map_details(catalog: Catalog, map_id: str, sees_who: SeesWho = everybody) -> dict[str, Any]:
    """One map, with the manifest of its active version if there is one.

    Raises:
        NotFound: no such map.
        CorruptVersion, IncompatibleVersion: as ``Catalog.manifest``.
    """
    state = catalog.state(map_id)
    if not state.exists:
        raise NotFound.of_map(map_id)
    details = {**map_summary(map_id, state), "versions": len(state.published)}
    if state.active is None:
        return details
    told = version_details(catalog, map_id, state.active, sees_who)
    return {**details, "provenance": told["provenance"], "manifest": told["manifest"]}


def version_details(
    catalog: Catalog, map_id: str, version: str, sees_who: SeesWho = everybody
) -> dict[str, Any]:
    """One version, with its manifest.

    Args:
        version: the whole digest.

    Raises:
        NotFound, CorruptVersion, IncompatibleVersion: as ``Catalog.manifest``.
    """
    manifest = catalog.manifest(map_id, version)
    told = version_summary(version_info(catalog.known_state(map_id), version), sees_who)
    return {"map_id": map_id, **told, "manifest": manifest.to_mapping()}
