"""Prefetch of maps by one replica alone, and by replicas that share the maps."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from firstfix.catalog.manifest import Manifest
from firstfix.catalog.rendezvous import rendezvous_order
from firstfix.errors import StoreUnavailable
from firstfix.store.store import Store
from firstfix_service.maps import loaded_versions
from firstfix_service.maps.placement import Placement
from tests.service.cache_world import Cache, World
from tests.service.service_world import FakeLocalizer
from tests.waiting import let_pass, wait_until

NAMES = [f"map-{k:02}" for k in range(24)]
REPLICAS = ["r1", "r2", "r3"]


@pytest.fixture
def world(tmp_path: Path) -> World:
    made = World(tmp_path, Store.open("memory://"))
    for k, name in enumerate(NAMES):
        made.publish(name, str(k))
    return made


def sharing(world: World, copies: int = 1, **changes: Any) -> Cache:
    placement = Placement("r1", copies)
    placement.set_replicas(REPLICAS)
    return world.cache(placement=placement, **{"max_versions": 30, **changes})


def held(names: list[str], copies: int = 1) -> set[str]:
    return {name for name in NAMES if "r1" in rendezvous_order(name, names)[:copies]}


def loaded(world: World) -> set[str]:
    return {NAMES[int(label)] for label in world.behaviour.loads}


@pytest.mark.parametrize("copies", [1, 2])
def test_only_held_maps_are_prefetched(world: World, copies: int):
    cache = sharing(world, copies)
    cache.poll()
    assert loaded(world) == held(REPLICAS, copies)
    assert cache.held_loaded == len(held(REPLICAS, copies))
    assert {name for name in NAMES if cache.is_offered(name)} == held(REPLICAS, copies)
    assert cache.served.ids == NAMES, "and all are served"


def test_maps_held_by_others_are_answered_too(world: World):
    cache = sharing(world)
    cache.poll()
    for k, name in enumerate(NAMES):
        assert (cache.get(name).directory / "label.txt").read_text() == str(k)


def test_held_maps_are_evicted_after_the_others_however_long_ago_they_were_used(world: World):
    own = held(REPLICAS)
    cache = sharing(world, max_versions=len(own) + 1)
    cache.poll()
    for name in NAMES * 2:
        cache.get(name)
    assert all(world.behaviour.loads.count(str(NAMES.index(name))) == 1 for name in own)
    assert cache.held_loaded == len(own)


def test_a_new_version_of_a_held_map_is_protected_in_place_of_the_old_one(world: World):
    own = sorted(held(REPLICAS))
    cache = sharing(world, max_versions=len(own) + 1)
    cache.poll()
    version = world.publish(own[0], "23")
    cache.poll()
    for name in NAMES:
        cache.get(name)
    assert (own[0], version) in cache._loaded
    assert cache.held_loaded == len(own)


def test_the_maps_of_a_stopped_replica_are_taken_over(world: World):
    cache = sharing(world)
    cache.poll()
    cache.served.take_touched()
    before, after = held(REPLICAS), held(["r1", "r3"])
    offered: list[set[str]] = []
    cache.set_replicas(
        ["r1", "r3"], lambda: offered.append({n for n in cache.served.take_touched() if cache.is_offered(n)})
    )
    assert loaded(world) == after
    assert offered[0] == after - before, "a first holder is there at once: there is no other"
    cache.set_replicas(REPLICAS)
    assert {name for name in NAMES if cache.is_offered(name)} == before
    loads = len(world.behaviour.loads)
    cache.set_replicas(["r1", "r3"])
    assert len(world.behaviour.loads) == loads, "what has come back was still there"


def test_a_second_holder_serves_a_map_once_it_is_loaded(world: World):
    cache = sharing(world, copies=2)
    cache.poll()
    cache.served.take_touched()
    gained = held(["r1", "r2"], 2) - held(REPLICAS, 2)
    assert gained
    offered: list[set[str]] = []
    cache.set_replicas(
        ["r1", "r2"], lambda: offered.append({name for name in gained if cache.is_offered(name)})
    )
    assert offered == [{n for n in gained if rendezvous_order(n, ["r1", "r2"])[0] == "r1"}, gained]


def test_without_room_for_all_only_the_first_holder_offers_a_map(world: World):
    firsts = held(REPLICAS)
    cache = sharing(world, copies=2, max_versions=len(firsts) + 1)
    cache.poll()
    seconds = loaded(world) - firsts
    assert loaded(world) >= firsts, "they come first"
    assert len(seconds) == 1
    assert {name for name in NAMES if cache.is_offered(name)} == firsts | seconds
    for name in firsts:
        cache.get(name)
    cache.served.take_touched()
    other = min(held(REPLICAS, 2) - firsts - seconds)
    cache.get(other)
    assert {name for name in NAMES if cache.is_offered(name)} == firsts | {other}, "it took the other's place"
    assert cache.served.take_touched() >= {other, *seconds}


def test_the_first_holders_maps_come_first_however_slowly_the_store_tells_of_them(world, monkeypatch):
    firsts = held(REPLICAS)
    manifest = world.catalog.manifest

    def slow_for_the_last_of_them(map_id: str, version: str) -> Manifest:
        if map_id == max(firsts):
            let_pass(0.3)
        return manifest(map_id, version)

    monkeypatch.setattr(world.catalog, "manifest", slow_for_the_last_of_them)
    sharing(world, copies=2, max_versions=len(firsts)).poll()
    assert loaded(world) == firsts


def test_a_superseded_prefetch_ends_and_the_next_one_goes_on(world: World):
    cache = sharing(world)
    cache.poll()
    before, after = held(REPLICAS), held(["r1"])
    cache.set_replicas(["r1"], is_superseded=lambda: len(world.behaviour.loads) >= len(before) + 2)
    assert len(before) + 2 <= len(world.behaviour.loads) <= len(before) + 9 < len(after)
    cache.set_replicas(["r1"])
    assert loaded(world) == after == set(NAMES)


def test_replicas_that_change_during_the_first_poll_are_followed(world: World):
    first = threading.Event()

    def load(directory: Path) -> FakeLocalizer:
        if not first.is_set():
            first.set()
            cache.set_replicas(["r1", "r3"])
        return world.behaviour.load(directory)

    cache = sharing(world, load=load)
    cache.poll()
    assert loaded(world) == held(["r1", "r3"])


@pytest.mark.parametrize("limits", [{"max_versions": 3}, {"max_bytes": 5}])
@pytest.mark.parametrize("make", [World.cache, sharing], ids=["alone", "sharing"])
def test_no_more_is_prefetched_than_there_is_room_for(world, make, limits):
    cache = make(world, **limits)
    cache.poll()
    size = sum(len(label) for label in world.behaviour.loads)
    if "max_bytes" in limits:
        assert 4 <= size <= 5
    else:
        assert len(world.behaviour.loads) == 3
    assert not world.metric("firstfix_version_evictions_total"), "nothing is evicted for it"


def test_a_map_that_could_not_be_fetched_is_tried_again(world: World, monkeypatch: pytest.MonkeyPatch):
    cache = sharing(world)
    fetch = world.catalog.fetch_version
    fails = True

    def fetch_version(map_id: str, version: str, directory: Path) -> Path:
        if fails and map_id == min(held(REPLICAS)):
            raise StoreUnavailable("gone")
        return fetch(map_id, version, directory)

    monkeypatch.setattr(world.catalog, "fetch_version", fetch_version)
    cache.poll()
    assert loaded(world) == held(REPLICAS) - {min(held(REPLICAS))}
    fails = False
    cache.set_replicas(REPLICAS)
    assert loaded(world) == held(REPLICAS)


def test_a_new_map_is_loaded_by_its_holder(world: World):
    cache = sharing(world)
    cache.poll()
    new = [f"new-{k}" for k in range(8)]
    for name in new:
        world.publish(name, "5")
    before = len(world.behaviour.loads)
    cache.poll()
    mine = {name for name in new if rendezvous_order(name, REPLICAS)[0] == "r1"}
    assert mine
    assert len(world.behaviour.loads) - before == len(mine)
    assert {name for name in new if cache.is_offered(name)} == mine
    assert set(new) <= cache.served.take_touched()


def test_a_stopped_prefetch_loads_no_map(world: World):
    cache = sharing(world)
    cache.stop_prefetch()
    cache.poll()
    assert not world.behaviour.loads
    assert cache.get(NAMES[0]).map_id == NAMES[0]
    wait_until(lambda: cache.served.version(NAMES[0]) is not None)


def test_a_map_that_was_seen_before_its_version_was_activated_is_loaded(world, monkeypatch):
    monkeypatch.setattr(loaded_versions, "MAX_AHEAD", 40)
    cache = world.cache(max_versions=40)
    cache.poll()
    version = world.publish("new", "5")
    log = world.catalog.store.list("maps/new/log")
    activation = world.catalog.store.get(log[1])
    world.catalog.store.delete(log[1])
    before = len(world.behaviour.loads)
    world.catalog._logs.clear()
    cache.poll()
    assert "new" not in cache.served
    assert world.catalog.store.put_new(log[1], activation)
    world.catalog.changes.note("new")
    cache.poll()
    assert cache.served.version("new") == version
    assert len(world.behaviour.loads) == before + 1
