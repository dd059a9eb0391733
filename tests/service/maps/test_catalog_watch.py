"""Cost of a poll of the catalog; and every map is read within a sweep."""

from __future__ import annotations

from collections import Counter

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store, StoredObject
from firstfix_service.maps.catalog_watch import MAX_LOGS_PER_S, CatalogWatch


class Counts(Store):
    calls: Counter[str]

    def get(self, key: str, *, max_bytes: int | None = None) -> bytes:
        self.calls["get"] += 1
        return super().get(key, max_bytes=max_bytes)

    def exists(self, key: str) -> bool:
        self.calls["exists"] += 1
        return super().exists(key)

    def scan(self, prefix: str = "", *, after: str | None = None) -> list[StoredObject]:
        self.calls["list"] += 1
        return super().scan(prefix, after=after)

    def folders(self, prefix: str = "") -> list[str]:
        self.calls["list"] += 1
        return super().folders(prefix)


MAPS = 3000


@pytest.fixture
def catalog() -> Catalog:
    store = Counts.open("memory://")
    assert isinstance(store, Counts)
    store.calls = Counter()
    for k in range(MAPS):
        store.put_new(f"maps/map-{k:04}/log/000001.json", b"{}")
    return Catalog(store)


def test_thousands_of_maps_cost_a_few_calls_a_poll(catalog: Catalog):
    watch = CatalogWatch(catalog, interval_s=2, sweep_s=1200)
    names, listed = watch.poll()
    assert len(names) == MAPS
    assert listed == set(names)
    seen: set[str] = set()
    assert isinstance(catalog.store, Counts)
    for _ in range(600):
        catalog.store.calls.clear()
        names, _ = watch.poll()
        assert len(names) == MAPS / 600, "logs that are then read"
        assert sum(catalog.store.calls.values()) <= 4
        seen.update(names)
    assert len(seen) == MAPS


def test_however_many_maps_there_are_no_more_than_some_logs_are_read_a_second(catalog: Catalog):
    watch = CatalogWatch(catalog, interval_s=2, sweep_s=60)
    watch.poll()
    polls = [watch.poll()[0] for _ in range(MAPS // (2 * MAX_LOGS_PER_S))]
    assert {len(names) for names in polls} == {2 * MAX_LOGS_PER_S}, "30 polls would have to read 100 each"
    assert len({name for names in polls for name in names}) == MAPS, "and each has its turn"


def test_a_notice_is_followed_at_the_next_poll(catalog: Catalog):
    catalog.changes.note("map-0007")
    watch = CatalogWatch(catalog, interval_s=2, sweep_s=1200)
    watch.poll()
    watch.poll()
    writer = Catalog(catalog.store)
    writer.changes.note("map-2999")
    writer.changes.note("brand-new")
    names, _ = watch.poll()
    assert names[:2] == ["map-2999", "brand-new"]
    assert "brand-new" not in watch.poll()[0]


def test_a_few_maps_are_read_at_each_poll():
    catalog = Catalog(Store.open("memory://"))
    watch = CatalogWatch(catalog, interval_s=2, sweep_s=60)
    assert watch.poll() == ([], frozenset())
    catalog.store.put_new("maps/attic/log/000001.json", b"{}")
    assert watch.poll() == (["attic"], {"attic"})
    assert watch.poll()[0] == ["attic"]


def test_after_a_reset_all_maps_are_read(catalog: Catalog):
    watch = CatalogWatch(catalog, interval_s=2, sweep_s=1200)
    watch.poll()
    watch.poll()
    watch.reset()
    assert len(watch.poll()[0]) == MAPS
