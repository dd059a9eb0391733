"""Administration of maps and versions, with a service or with the store itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Protocol

from firstfix.errors import InvalidOption, NotFound

from .arguments import client_of

if TYPE_CHECKING:
    from firstfix.builds.config import PatchMode
    from firstfix.catalog.catalog import Catalog
    from firstfix_client import Client

Record = dict[str, Any]


class MapAdmin(Protocol):
    """Operations of ``firstfix maps``. Both implementations return the same JSON-ready records."""

    def maps(self) -> list[Record]:
        """All maps."""

    def show(self, map_id: str) -> Record:
        """One map with the manifest of its active version."""

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

    def changes(self, map_id: str, version: str | None, *, with_cells: bool) -> Record:
        """The areas that have changed since the map was made."""

    def collect_garbage(self, map_id: str | None, *, dry_run: bool) -> Record:
        """Remove unreferenced objects. Returns counts by kind."""


@contextmanager
def map_admin(url: str | None, store: str | None) -> Iterator[MapAdmin]:
    """Give the administration of the service, or with ``store`` that of the store.

    Raises:
        InvalidOption: both are given.
    """
    if url is not None and store is not None:
        raise InvalidOption("give only one of --url and --store")
    if store is None:
        with client_of(url) as client:
            yield _ServiceMaps(client)
        return
    from firstfix.catalog.catalog import Catalog
    from firstfix.store.store import Store

    yield _StoreMaps(Catalog(Store.open(store)))


class _ServiceMaps:
    def __init__(self, client: Client) -> None:
        self._client = client

    def maps(self) -> list[Record]:
        return [dict(entry.details) for entry in self._client.maps()]

    def show(self, map_id: str) -> Record:
        return dict(self._client.show_map(map_id).details)

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

    def changes(self, map_id: str, version: str | None, *, with_cells: bool) -> Record:
        return dict(self._client.changes(map_id, version, cells=with_cells, grid=with_cells))

    def collect_garbage(self, map_id: str | None, *, dry_run: bool) -> Record:
        return {"objects": dict(self._client.collect_garbage(map_id, dry_run=dry_run)["objects"])}


class _StoreMaps:
    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog

    def maps(self) -> list[Record]:
        return [self._record(map_id) for map_id in self._catalog.map_ids()]

    def show(self, map_id: str) -> Record:
        if not self._catalog.state(map_id).exists:
            raise NotFound(f"no map {map_id}")
        record = self._record(map_id)
        record["versions"] = len(self._catalog.state(map_id).published)
        if record["active_version"] is not None:
            manifest = self._catalog.manifest(map_id, record["active_version"])
            record["manifest"] = manifest.to_mapping()
        return record

    def versions(self, map_id: str) -> list[Record]:
        return [asdict(entry) for entry in self._catalog.versions(map_id)]

    def activate(self, map_id: str, version: str) -> None:
        self._catalog.activate(map_id, version)

    def roll_back(self, map_id: str) -> str:
        return self._catalog.roll_back(map_id)

    def patch(self, map_id: str, mode: PatchMode | None) -> str:
        from firstfix.maintenance.patch import request_patch

        return request_patch(self._catalog, map_id, mode)

    def retire(self, map_id: str, version: str, *, force: bool) -> None:
        self._catalog.retire(map_id, version, force=force)

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

    def _record(self, map_id: str) -> Record:
        return {"map_id": map_id, "active_version": self._catalog.active_version(map_id)}
