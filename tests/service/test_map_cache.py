from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from service_world import Behaviour, FakeLocalizer, publish, wait_for

from firstfix.catalog import Catalog
from firstfix.errors import CorruptVersion, NotFound, StoreUnavailable
from firstfix.store import Store
from firstfix_service import map_cache
from firstfix_service.map_cache import MapCache, ServedVersion
from firstfix_service.map_poller import MapPoller
from firstfix_service.metrics import Metrics


class World:
    """A cache over a store in a directory, or over one that has to be fetched from."""

    def __init__(self, tmp_path: Path, store: Store) -> None:
        self.catalog = Catalog(store)
        self.scratch = tmp_path / "made"
        self.cache_dir = tmp_path / "cache"
        self.behaviour = Behaviour()
        self.metrics = Metrics()

    def cache(self, **changes: object) -> MapCache:
        values = {"max_versions": 8, "max_bytes": 1 << 30, "load": self.behaviour.load, **changes}
        return MapCache(self.catalog, self.cache_dir, self.metrics, **values)  # type: ignore[arg-type]

    def publish(self, map_id: str, label: str) -> str:
        return publish(self.catalog, map_id, label, self.scratch)

    def metric(self, name: str, **labels: str) -> float | None:
        return self.metrics.registry.get_sample_value(name, labels)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, Store.open(str(tmp_path / "store")))


@pytest.fixture
def remote(tmp_path: Path) -> World:
    return World(tmp_path, Store.open("memory://"))


def label(served: ServedVersion) -> float:
    assert isinstance(served.localizer, FakeLocalizer)
    return served.localizer.label


def damage(tmp_path: Path, map_id: str, version: str) -> None:
    path = tmp_path / "store" / "maps" / map_id / "versions" / version / "label.txt"
    path.write_text("7" * len(path.read_text()))


def test_the_active_version_is_served_and_loaded_once(world: World):
    version = world.publish("hall", "1")
    cache = world.cache()
    assert cache.get("hall").version == version
    assert cache.get("hall") is cache.get("hall", version)
    assert world.behaviour.loads == ["1"]


def test_many_askers_cause_one_load(world: World):
    world.publish("hall", "1")

    def slow(directory: Path) -> FakeLocalizer:
        time.sleep(0.2)
        return world.behaviour.load(directory)

    cache = world.cache(load=slow)
    with ThreadPoolExecutor(8) as threads:
        served = list(threads.map(lambda _: cache.get("hall"), range(8)))
    assert world.behaviour.loads == ["1"]
    assert len({id(s) for s in served}) == 1


def test_an_activation_is_followed_back_and_forward(world: World):
    first = world.publish("hall", "1")
    cache = world.cache()
    cache.poll()
    second = world.publish("hall", "2")
    assert cache.get("hall").version == first, "until the poll"
    cache.poll()
    assert cache.get("hall").version == second
    world.catalog.activate("hall", first)
    cache.poll()
    assert cache.get("hall").version == first
    assert world.behaviour.loads == ["1", "2"], "what is in memory is not loaded again"


def test_the_poll_loads_maps_ahead_of_their_first_query(world: World):
    world.publish("hall", "1")
    cache = world.cache()
    assert not cache.polled
    cache.poll()
    assert cache.polled
    assert world.behaviour.loads == ["1"]
    assert cache.map_ids == ("hall",)


@pytest.mark.parametrize("how", ["altered file", "cannot be understood"])
def test_the_previous_version_serves_when_the_new_one_is_bad(world: World, tmp_path: Path, how: str):
    good = world.publish("hall", "1")
    cache = world.cache()
    cache.poll()
    if how == "altered file":
        bad = world.publish("hall", "22")
        damage(tmp_path, "hall", bad)
    else:
        bad = world.publish("hall", "unreadable")
    cache.poll()
    cache.poll()
    assert cache.get("hall").version == good
    with pytest.raises(CorruptVersion):
        cache.get("hall", bad)
    assert world.metric("firstfix_maps_behind") == 1
    assert world.metric("firstfix_version_loads_total", result="corrupt_version") == 1, "not at every poll"
    assert world.cache().get("hall").version == good, "a replica that starts now does the same"

    third = world.publish("hall", "3")
    cache.poll()
    assert cache.get("hall").version == third
    assert world.metric("firstfix_maps_behind") == 0


def test_a_mended_version_is_taken_after_a_while(world: World, monkeypatch: pytest.MonkeyPatch):
    good, bad = world.publish("hall", "1"), world.publish("hall", "unreadable")
    cache = world.cache()
    assert cache.get("hall").version == good
    monkeypatch.setattr(world.behaviour, "load", lambda directory: FakeLocalizer(9, world.behaviour))
    mended = world.cache()  # its loader understands it
    assert mended.get("hall").version == bad
    cache._load_files = world.behaviour.load
    cache.poll()
    assert cache.get("hall").version == good, "not tried again at once"
    for refusal in list(cache._refused):
        cache._refused[refusal] = map_cache._Refusal(CorruptVersion("x"), time.monotonic() - 1)
    cache.poll()
    assert cache.get("hall").version == bad


def test_a_map_without_a_good_version_says_why(world: World):
    world.publish("hall", "unreadable")
    with pytest.raises(CorruptVersion, match="cannot be understood"):
        world.cache().get("hall")


def test_unknown_maps_and_versions(world: World):
    version = world.publish("hall", "1")
    cache = world.cache()
    with pytest.raises(NotFound):
        cache.get("attic")
    with pytest.raises(NotFound):
        cache.get("hall", "0" * 64)
    world.catalog.retire("hall", version, force=True)
    cache.poll()
    with pytest.raises(NotFound):
        cache.get("hall")


def test_a_retired_version_stops_answering(world: World):
    first = world.publish("hall", "1")
    cache = world.cache()
    world.publish("hall", "2")
    cache.poll()
    world.catalog.retire("hall", world.catalog.active_version("hall") or "", force=True)
    cache.poll()
    assert cache.get("hall").version == first


def test_the_least_recently_used_goes_first(world: World):
    for name in ("a", "b", "c"):
        world.publish(name, "1")
    cache = world.cache(max_versions=2)
    for name in ("a", "b", "a", "c"):
        cache.get(name)
    assert world.metric("firstfix_versions_loaded") == 2
    before = len(world.behaviour.loads)
    cache.get("a")
    assert len(world.behaviour.loads) == before, "a was used after b"
    cache.get("b")
    assert len(world.behaviour.loads) == before + 1
    cache.poll()
    assert len(world.behaviour.loads) == before + 1, "the poll does not bring back what was put out"


def test_the_bytes_are_bounded_but_one_version_always_fits(world: World):
    for name in ("a", "b"):
        world.publish(name, "12345")
    cache = world.cache(max_bytes=6)
    cache.get("a")
    cache.get("b")
    assert world.metric("firstfix_versions_loaded") == 1
    assert world.metric("firstfix_version_bytes") == 5
    assert label(world.cache(max_bytes=1).get("a")) == 12345


def test_fetched_files_leave_the_disk_with_their_version(remote: World):
    first = remote.publish("a", "1")
    second = remote.publish("b", "2")
    cache = remote.cache(max_versions=1)
    cache.get("a")
    assert (remote.cache_dir / first).is_dir()
    cache.get("b")
    assert not (remote.cache_dir / first).exists()
    assert (remote.cache_dir / second).is_dir()
    assert label(cache.get("a")) == 1, "and come back when they are asked for"


def test_a_file_stores_own_files_are_never_removed(world: World, tmp_path: Path):
    versions = {name: world.publish(name, "1") for name in ("a", "b")}
    cache = world.cache(max_versions=1)
    for name in ("a", "b", "a"):
        cache.get(name)
    for name, version in versions.items():
        assert (tmp_path / "store/maps" / name / "versions" / version / "label.txt").is_file()


def test_what_is_loaded_goes_on_when_the_store_does_not(world: World, monkeypatch: pytest.MonkeyPatch):
    world.publish("hall", "1")
    cache = world.cache()
    polls = 0

    def fails() -> list[str]:
        nonlocal polls
        polls += 1
        raise StoreUnavailable("gone")

    cache.poll()
    monkeypatch.setattr(world.catalog, "map_ids", fails)
    poller = MapPoller(cache, 0.01)
    poller.start()
    wait_for(lambda: polls >= 3)
    poller.close()
    assert label(cache.get("hall")) == 1


def test_the_poller_outlives_a_defect(world: World):
    cache = world.cache()
    world.publish("hall", "1")
    calls: list[int] = []
    done = threading.Event()

    def after() -> None:
        calls.append(1)
        if len(calls) < 3:
            raise RuntimeError("a defect")
        done.set()

    hook: Callable[[], None] = after
    poller = MapPoller(cache, 0.01, after=hook)
    poller.start()
    assert done.wait(10)
    poller.close()
