"""Administration of maps and versions, with a service or with the store itself."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

from firstfix.catalog.version_prefix import full_version
from firstfix.errors import NotFound

from .administered import administered

if TYPE_CHECKING:
    from firstfix.builds.config import PatchMode
    from firstfix.catalog.catalog import Catalog

    from .operator_client import OperatorClient

Record = dict[str, Any]


class MapAdmin(Protocol):
    """Operations of ``firstfix maps``. Both implementations return the same JSON-ready records."""

    def maps(self) -> list[Record]:
        """All maps, with what their active versions are."""

    def full_version(self, map_id: str, given: str) -> str:
        """The only version of a map that begins with the given characters."""

    def show(self, map_id: str, version: str | None = None) -> Record:
        """One map with the manifest of its active version, or of another one."""

    def versions(self, map_id: str) -> list[Record]:
        """The versions of a map, newest first."""

    def activate(self, map_id: str, version: str) -> None:
        """Make a version the active one."""

    def roll_back(self, map_id: str) -> str:
        """Make the previously active version active again, and return it."""

    def patch(self, map_id: str, mode: PatchMode | None) -> str:
        """Record a build that patches the map, and return its id."""

    def retire(self, map_id: str, version: str, *, force: bool) -> None:
        """Take a version out of service."""

    def remove(self, map_id: str) -> list[str]:
        """Take all versions of a map out of service, and return them."""

    def changes(self, map_id: str, version: str | None, *, with_cells: bool) -> Record:
        """The areas that have changed since the map was made."""

    def collect_garbage(self, map_id: str | None, *, dry_run: bool) -> Record:
        """Remove unreferenced objects. Returns counts by kind."""


def map_admin(url: str | None, store: str | None) -> AbstractContextManager[MapAdmin]:
    """Give the administration of the service, or with ``store`` that of the store.

    Raises:
        InvalidOption, NotFound: as ``administered``.
    """
    return administered(url, store, _ServiceMaps, _StoreMaps)


class _ServiceMaps:
    def __init__(self, client: OperatorClient) -> None:
        self._client = client

    def maps(self) -> list[Record]:
        return [dict(entry.details) for entry in self._client.maps()]

    def full_version(self, map_id: str, given: str) -> str:
        return full_version(given, (entry.version for entry in self._client.versions(map_id)))

    def show(self, map_id: str, version: str | None = None) -> Record:
        shown = dict(self._client.show_map(map_id).details)
        return shown if version is None else {**shown, **self._client.version_details(map_id, version)}

    def versions(self, map_id: str) -> list[Record]:
        return [dict(entry.details) for entry in self._client.versions(map_id)]

    def activate(self, map_id: str, version: str) -> None:
        self._client.activate(map_id, version)

    def roll_back(self, map_id: str) -> str:
        return self._client.roll_back(map_id)

    def patch(self, map_id: str, mode: PatchMode | None) -> str:
        return self._client.patch(map_id, mode)

    def retire(self, map_id: str, version: str, *, force: bool) -> None:
        self._client.retire(map_id, version, force=force)

    def remove(self, map_id: str) -> list[str]:
        return self._client.delete_map(map_id)

    def changes(self, map_id: str, version: str | None, *, with_cells: bool) -> Record:
        return dict(self._client.changes(map_id, version, cells=with_cells, grid=with_cells))

    def collect_garbage(self, map_id: str | None, *, dry_run: bool) -> Record:
        return {"objects": dict(self._client.collect_garbage(map_id, dry_run=dry_run)["objects"])}


class _StoreMaps:
    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog

    def maps(self) -> list[Record]:
        from firstfix.catalog.described import map_summary

        return [map_summary(map_id, self._catalog.state(map_id)) for map_id in self._catalog.map_ids()]

    def full_version(self, map_id: str, given: str) -> str:
        return self._catalog.full_version(map_id, given)

    def show(self, map_id: str, version: str | None = None) -> Record:
        from firstfix.catalog.described import map_details, version_details

        details = map_details(self._catalog, map_id)
        return details if version is None else {**details, **version_details(self._catalog, map_id, version)}

    def versions(self, map_id: str) -> list[Record]:
        from firstfix.catalog.described import version_summary

        return [version_summary(entry) for entry in self._catalog.versions(map_id)]

    def activate(self, map_id: str, version: str) -> None:
        self._catalog.activate(map_id, version)

    def roll_back(self, map_id: str) -> str:
        return self._catalog.roll_back(map_id)

    def patch(self, map_id: str, mode: PatchMode | None) -> str:
        from firstfix.maintenance.patch import request_patch

        return request_patch(self._catalog, map_id, mode)

    def retire(self, map_id: str, version: str, *, force: bool) -> None:
        self._catalog.retire(map_id, version, force=force)

    def remove(self, map_id: str) -> list[str]:
        return self._catalog.remove_map(map_id)

    def changes(self, map_id: str, version: str | None, *, with_cells: bool) -> Record:
        from firstfix.catalog.sightings.changes import changes_of
        from firstfix.catalog.sightings.sightings import Sightings

        wanted = version or self._catalog.active_version(map_id)
        if wanted is None:
            raise NotFound(f"map {map_id} has no active version")
        record = Sightings(self._catalog.store).read(self._catalog.folder_of(map_id, wanted))
        found = changes_of(record, limit=1000, with_cells=with_cells, with_grid=with_cells)
        return {"map_id": map_id, "version": wanted, **found}

    def collect_garbage(self, map_id: str | None, *, dry_run: bool) -> Record:
        from firstfix.maintenance.garbage import collect_garbage

        found = collect_garbage(self._catalog, map_id=map_id, dry_run=dry_run)
        return {"objects": {kind: len(keys) for kind, keys in found.keys.items()}}
