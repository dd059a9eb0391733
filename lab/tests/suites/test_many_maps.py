"""The suite of many maps, with few: a replica over a catalog of links, and four that share a small one."""

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_lab.common.small_map import query_of
from firstfix_lab.suites.many_maps.catalogs import grow_catalog, name_of
from firstfix_lab.suites.many_maps.one_replica import one_replica
from firstfix_lab.suites.many_maps.sharing import movement, shares, takeover, zipf

pytestmark = pytest.mark.slow


def test_the_catalog_is_one_that_was_published(small_version, tmp_path: Path):
    grow_catalog(tmp_path / "store", small_version.directory, 0, 3)
    grow_catalog(tmp_path / "store", small_version.directory, 3, 5)
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    assert catalog.map_ids() == [name_of(number) for number in range(5)]
    assert catalog.changes.end() == 5
    versions = {catalog.active_version(map_id) for map_id in catalog.map_ids()}
    assert len(versions) == 5, "each has a version of its own"
    for map_id in catalog.map_ids():
        version = str(catalog.active_version(map_id))
        folder = catalog.fetch_version(map_id, version, tmp_path / "cache")
        assert (folder / "mark.txt").read_text() == map_id


def test_what_a_replica_pays_is_told(small_version, tmp_path: Path):
    store = tmp_path / "store"
    grow_catalog(store, small_version.directory, 0, 24)
    body = query_of(small_version.directory)
    figures = one_replica(str(store), 24, body, tmp_path / "replica", idle_s=2.5, seed=1)
    # logs and their entries; notices, keys and what is loaded besides
    assert figures["requests_until_ready"] >= 24 * 3
    # and of each map the templates with their manifest, for the coarse index
    assert figures["requests_until_indexed"] < 24 * (3 + 6) + 16 * 10
    assert figures["requests_a_minute"] < 200
    assert figures["requests_a_cold_query"] > 0
    assert figures["cold_query_ms"] > 0
    assert figures["warm_query_ms"] > 0


def test_sharing_is_worth_what_it_costs(tmp_path: Path):
    found = shares(tmp_path, maps=80, queries=1500, cache_shares=(0.2, 0.6), seed=1)
    met = {(one["cache"], one["asked"], one["copies"]): one["met_loaded"] for one in found}
    for cache in (0.2, 0.6):
        for copies in (1, 2):
            assert met[cache, "holders", copies] > met[cache, "any replica", 0] + 0.05
    assert met[0.6, "holders", 2] == 1.0, "all fit, and were loaded before they were asked for"


@pytest.mark.parametrize("copies", [1, 2])
def test_a_replica_that_leaves_moves_its_own_maps_alone(copies: int):
    moved = movement(1000, 4, copies)
    assert moved["taken_over"] == pytest.approx(0.25, abs=0.04)
    assert moved["lost_by_others"] == 0


def test_the_others_load_what_one_had(tmp_path: Path):
    figures = takeover(tmp_path, 60, 2)
    assert figures["loads"] == figures["maps_held_by_one"] > 20
    assert figures["loaded_after"] == 2 * 60


def test_few_maps_get_most_queries():
    asked = zipf(1000, 5000, 1.0, 1)
    assert asked == zipf(1000, 5000, 1.0, 1)
    most = max(set(asked), key=asked.count)
    assert 0.1 < asked.count(most) / 5000 < 0.17
