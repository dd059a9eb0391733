"""Map cache over a real store, with fake localizers."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_service.maps.map_cache import MapCache
from firstfix_service.maps.served_maps import Leases
from firstfix_service.query_workers.base import QueryWorkerThreads
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.telemetry.metrics import Metrics
from tests.service.service_world import Behaviour, publish
from tests.waiting import LIMIT_S


class Cache(MapCache):
    """A map cache whose leases are waited for."""

    def get(self, map_id: str, version: str | None = None) -> ServedVersion:
        leases = self.leased(map_id, version=version)
        leases.close()
        (served,) = leases.served
        return served

    def leased(self, *map_ids: str, version: str | None = None) -> Leases:
        return self.lease(map_ids, version).result(LIMIT_S)

    def lease(self, map_ids: Sequence[str], version: str | None = None) -> Future[Leases]:
        return self.served.lease(map_ids, version)


class World:
    """A map cache over a directory store, or over a store whose versions must be fetched."""

    def __init__(self, tmp_path: Path, store: Store) -> None:
        self.catalog = Catalog(store)
        self.scratch = tmp_path / "made"
        self.cache_dir = tmp_path / "cache"
        self.behaviour = Behaviour()
        self.metrics = Metrics()

    def cache(self, **changes: object) -> Cache:
        load = changes.pop("load", self.behaviour.load)
        self.workers = QueryWorkerThreads(load)  # type: ignore[arg-type]
        values = {"max_versions": 8, "max_bytes": 1 << 30, "max_disk_bytes": 1 << 30, **changes}
        return Cache(self.catalog, self.cache_dir, self.workers, self.metrics, **values)  # type: ignore[arg-type]

    def publish(self, map_id: str, label: str) -> str:
        return publish(self.catalog, map_id, label, self.scratch)

    def metric(self, name: str, **labels: str) -> float | None:
        return self.metrics.registry.get_sample_value(name, labels)
