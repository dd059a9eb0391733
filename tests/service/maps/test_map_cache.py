from __future__ import annotations

import os
import random
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from firstfix.catalog.manifest import Manifest
from firstfix.errors import CorruptVersion, NotFound, StoreUnavailable
from firstfix.store.store import Store
from firstfix_service.maps import map_cache, version_loader
from firstfix_service.maps.map_poller import MapPoller
from firstfix_service.query_workers.query import ServedVersion
from tests.service.cache_world import World
from tests.service.service_world import FakeLocalizer
from tests.waiting import LIMIT_S, let_pass, wait_until


@pytest.fixture
def remote(tmp_path: Path) -> World:
    return World(tmp_path, Store.open("memory://"))


def label(served: ServedVersion) -> float:
    return float((served.directory / "label.txt").read_text())


def damage(tmp_path: Path, map_id: str, version: str) -> None:
    path = tmp_path / "store" / "maps" / map_id / "versions" / version / "label.txt"
    path.write_text("7" * len(path.read_text()))


def test_the_active_version_is_served_and_loaded_once(world: World):
    version = world.publish("hall", "1")
    cache = world.cache()
    assert cache.get("hall").version == version
    assert cache.get("hall") is cache.get("hall", version)
    assert cache.served.versions == {"hall": version}
    assert world.behaviour.loads == ["1"]


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
    assert cache.served.ids == ["hall"]


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


def test_a_mended_version_is_tried_again_after_a_while(world: World, monkeypatch: pytest.MonkeyPatch):
    good, bad = world.publish("hall", "1"), world.publish("hall", "unreadable")
    cache = world.cache()
    assert cache.get("hall").version == good
    monkeypatch.setattr(world.behaviour, "load", lambda directory: FakeLocalizer(9, world.behaviour))
    mended = world.cache()  # its loader can read it
    assert mended.get("hall").version == bad
    monkeypatch.setattr(cache._loader._loaded, "_workers", world.workers)
    cache.poll()
    assert cache.get("hall").version == good, "not tried again at once"
    refused = cache._loader._refused
    assert refused
    for key in refused:
        refused[key] = version_loader._Refusal(CorruptVersion("x"), time.monotonic() - 1)
    cache.poll()
    assert cache.get("hall").version == bad


def test_a_map_without_a_good_version_is_corrupt(world: World):
    world.publish("hall", "unreadable")
    with pytest.raises(CorruptVersion, match="cannot be understood"):
        world.cache().get("hall")


def test_unknown_maps_and_versions_are_not_found(world: World):
    version = world.publish("hall", "1")
    cache = world.cache()
    with pytest.raises(NotFound, match="no map attic"):
        cache.get("attic")
    with pytest.raises(NotFound):
        cache.get("hall", "0" * 64)
    world.catalog.retire("hall", version, force=True)
    cache.poll()
    with pytest.raises(NotFound, match="map hall has no version any more"):
        cache.get("hall")


def test_a_retired_version_stops_answering(world: World):
    first = world.publish("hall", "1")
    cache = world.cache()
    world.publish("hall", "2")
    cache.poll()
    world.catalog.retire("hall", world.catalog.active_version("hall") or "", force=True)
    cache.poll()
    assert cache.get("hall").version == first


def test_a_map_without_an_active_version_is_logged_once(world: World):
    directory = world.scratch / "held"
    directory.mkdir(parents=True)
    (directory / "label.txt").write_text("1")
    manifest = Manifest.for_directory(directory)
    world.catalog.publish("held", directory, manifest, activate=False)
    world.publish("hall", "1")
    cache = world.cache()
    with capture_logs() as lines:
        for _ in range(4):
            cache.poll()
    assert [line["map_id"] for line in lines if line["log_level"] == "warning"] == ["held"]
    assert "held" not in cache.served
    with pytest.raises(NotFound, match="no active version"):
        cache.get("held")
    world.catalog.activate("held", world.catalog.publish("held", directory, manifest, activate=False))
    cache.poll()
    assert "held" in cache.served


def test_the_least_recently_used_is_evicted(world: World):
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
    assert len(world.behaviour.loads) == before + 1, "the poll does not load evicted versions again"


def test_the_bytes_are_bounded_but_one_version_always_fits(world: World):
    for name in ("a", "b"):
        world.publish(name, "12345")
    cache = world.cache(max_bytes=6)
    cache.get("a")
    cache.get("b")
    assert world.metric("firstfix_versions_loaded") == 1
    assert world.metric("firstfix_version_bytes") == 5
    assert label(world.cache(max_bytes=1).get("a")) == 12345


def test_fetched_files_stay_on_the_disk_within_its_limit(remote: World):
    versions = [remote.publish(name, str(k)) for k, name in enumerate("abc")]
    cache = remote.cache(max_versions=1, max_disk_bytes=2)
    for k, name in enumerate("ab"):
        cache.get(name)
        marker = remote.cache_dir / f".{versions[k]}.verified"
        os.utime(marker, (k, k))
    assert {path.name for path in remote.cache_dir.iterdir()} >= set(versions[:2])
    cache.get("c")
    left = {path.name.strip(".").split(".")[0] for path in remote.cache_dir.iterdir()}
    assert left == set(versions[1:]), "the one used longest ago went, with its marker and lock"
    assert label(cache.get("a")) == 0, "and comes back when it is asked for"


def test_the_disk_is_not_pruned_at_each_load(remote: World, monkeypatch: pytest.MonkeyPatch):
    looks: list[Path] = []
    monkeypatch.setattr(version_loader, "prune", lambda directory, limit: looks.append(directory) or [])
    cache = remote.cache(max_versions=20, max_disk_bytes=450)
    for k in range(12):
        remote.publish(f"map-{k}", str(k))
        cache.get(f"map-{k}")
    # 14 bytes were fetched: at the start, and then for each 4
    assert len(looks) == 4


def test_files_in_use_never_leave_the_disk(remote: World):
    first, _ = remote.publish("a", "1"), remote.publish("b", "2")
    cache = remote.cache(max_versions=1, max_disk_bytes=0)
    leases = cache.leased("a")
    asked = cache.lease(["b"])
    assert (remote.cache_dir / first).is_dir()
    leases.close()
    asked.result(LIMIT_S).close()
    cache.get("a")
    cache.get("b")
    assert not (remote.cache_dir / first).exists()


def test_a_file_stores_own_files_are_never_removed(world: World, tmp_path: Path):
    versions = {name: world.publish(name, "1") for name in ("a", "b")}
    cache = world.cache(max_versions=1)
    for name in ("a", "b", "a"):
        cache.get(name)
    for name, version in versions.items():
        assert (tmp_path / "store/maps" / name / "versions" / version / "label.txt").is_file()


def test_loaded_versions_answer_while_the_store_is_away(world: World, monkeypatch: pytest.MonkeyPatch):
    world.publish("hall", "1")
    cache = world.cache()
    polls = 0

    def fails() -> list[str]:
        nonlocal polls
        polls += 1
        raise StoreUnavailable("gone")

    cache.poll()
    monkeypatch.setattr(cache._watch, "poll", fails)
    poller = MapPoller(cache, 0.01)
    poller.start()
    wait_until(lambda: polls >= 3)
    poller.close()
    assert label(cache.get("hall")) == 1


def test_the_poller_goes_on_after_an_error(world: World):
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
    assert done.wait(LIMIT_S)
    poller.close()


def test_a_version_that_a_query_uses_stays_until_it_is_given_back(world: World):
    for name in "ab":
        world.publish(name, "1")
    cache = world.cache(max_versions=1)
    leases = cache.leased("a")
    asked = cache.lease(["b"])
    let_pass(0.1)
    assert not asked.done(), "the limit holds also while a query goes on"
    assert list(world.workers.loaded) == list(leases.served)
    leases.close()
    asked.result(LIMIT_S).close()
    assert len(world.workers.loaded) == 1


def test_an_evicted_version_is_loaded_again_for_a_new_query(world: World):
    for name in "ab":
        world.publish(name, "1")
    cache = world.cache(max_versions=1)
    leases = cache.leased("a")
    first = cache.lease(["b"])
    wait_until(lambda: ("a", leases.served[0].version) not in cache._loaded)
    second = cache.lease(["a"])
    leases.close()
    first.result(LIMIT_S).close()
    second.result(LIMIT_S).close()
    assert world.behaviour.loads == ["1"] * 3


def test_a_query_over_more_maps_than_the_limit_gets_them_all(world: World):
    for name in "abc":
        world.publish(name, "1")
    cache = world.cache(max_versions=1)
    leases = cache.leased("a")
    both = cache.leased("b", "a", "c")
    assert [served.map_id for served in both.served] == ["b", "a", "c"]
    both.close()
    leases.close()
    cache.get("a")
    wait_until(lambda: len(world.workers.loaded) == 1)


def test_a_bad_map_of_several_releases_the_others(world: World):
    world.publish("good", "1")
    world.publish("bad", "unreadable")
    cache = world.cache(max_versions=1)
    with pytest.raises(CorruptVersion):
        cache.leased("good", "bad")
    world.publish("next", "2")
    cache.get("next")
    assert len(world.workers.loaded) == 1, "no lease of the good one is left"


def test_ten_maps_of_which_three_fit_are_all_answered_within_the_limit(world: World):
    names = [f"map-{k}" for k in range(10)]
    for k, name in enumerate(names):
        world.publish(name, str(k))
    most = 0

    def load(directory: Path) -> FakeLocalizer:
        nonlocal most
        most = max(most, len(world.workers.loaded) + 1)
        let_pass(0.002)
        return world.behaviour.load(directory)

    cache = world.cache(max_versions=3, load=load)
    cache.poll()

    def ask(k: int) -> None:
        leases = cache.leased(names[k])
        assert label(leases.served[0]) == k
        assert leases.served[0] in world.workers.loaded
        leases.close()

    rng = random.Random(1)
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(ask, [rng.randrange(10) for _ in range(300)]))
    assert most <= 3
    assert len(world.behaviour.loads) > 10


def test_a_pinned_map_is_loaded_first_and_stays(world: World):
    versions = {name: world.publish(name, str(k)) for k, name in enumerate("abcz")}
    cache = world.cache(max_versions=2, pinned=["z", "not-there"])
    cache.poll()
    assert world.behaviour.loads[0] == "3"
    for name in "abcab":
        cache.get(name)
    assert world.behaviour.loads.count("3") == 1
    new = world.publish("z", "4")
    cache.poll()
    for name in "abc":
        cache.get(name)
    assert cache.get("z").version == new
    assert world.behaviour.loads.count("4") == 1
    assert cache.served.versions["z"] != versions["z"]


def test_the_old_version_serves_until_the_new_one_is_loaded(world: World):
    first = world.publish("hall", "1")
    gate = threading.Event()

    begun = threading.Event()

    def load(directory: Path) -> FakeLocalizer:
        if (directory / "label.txt").read_text() == "2":
            begun.set()
            assert gate.wait(LIMIT_S)
        return world.behaviour.load(directory)

    cache = world.cache(max_versions=1, load=load)
    cache.poll()
    second = world.publish("hall", "2")
    polling = threading.Thread(target=cache.poll)
    polling.start()
    assert begun.wait(LIMIT_S)
    lease = cache.lease(["hall"])
    assert lease.done(), "nobody waits for the new one"
    assert lease.result().served[0].version == first
    gate.set()
    polling.join(LIMIT_S)
    assert cache.get("hall").version == second
    lease.result().close()
    wait_until(lambda: len(world.workers.loaded) == 1)


def test_an_unexpected_error_in_loading_refuses_the_version(world: World):
    good, _ = world.publish("hall", "1"), world.publish("hall", "2")

    def load(directory: Path) -> FakeLocalizer:
        if (directory / "label.txt").read_text() == "2":
            raise MemoryError
        return world.behaviour.load(directory)

    cache = world.cache(load=load)
    cache.poll()
    assert cache.get("hall").version == good
    assert world.metric("firstfix_maps_behind") == 1


def test_a_map_is_followed_although_its_notice_was_lost(world: World, monkeypatch: pytest.MonkeyPatch):
    world.publish("hall", "1")
    cache = world.cache(poll_interval_s=1.0, sweep_interval_s=3.0)
    cache.poll()
    monkeypatch.setattr(world.catalog.changes, "note", lambda map_id: None)
    second, other = world.publish("hall", "2"), world.publish("attic", "3")
    for _ in range(4):
        cache.poll()
    assert cache.served.versions == {"hall": second, "attic": other}
    assert cache.served.ids == ["attic", "hall"]
    for key in world.catalog.store.list("maps/attic"):
        world.catalog.store.delete(key)
    for _ in range(4):
        cache.poll()
    assert cache.served.ids == ["hall"]
    assert cache.served.versions == {"hall": second}


def test_invented_ids_leave_no_trace(world: World):
    cache = world.cache()
    for k in range(20):
        with pytest.raises(NotFound):
            cache.get(f"made-up-{k}")
    traces = (cache._loads._loads, cache.served.versions, cache._prefetcher._settled, cache.served.ids)
    assert not any((*traces, cache._loader._under_way, cache._loader._refused))


def test_a_version_is_warmed_up_before_it_is_served_and_the_old_one_answers_until_then(world, monkeypatch):
    first = world.publish("hall", "1")
    cache = world.cache()
    while_warming: list[tuple[str, str | None, str]] = []

    def warm_up(served: ServedVersion) -> int:
        now = cache.served.version("hall")
        answering = served.version if now is None else cache.get("hall").version
        while_warming.append((served.version, now, answering))
        return 3

    monkeypatch.setattr(world.workers, "warm_up", warm_up)
    cache.poll()
    second = world.publish("hall", "2")
    cache.poll()
    world.catalog.activate("hall", first)  # a rollback, at once and not by the poll
    cache.refresh("hall")
    assert while_warming == [(first, None, first), (second, first, first), (first, second, second)]
    assert cache.served.versions == {"hall": first}
    assert world.metric("firstfix_version_warm_ups_total", result="ok") == 3


def test_a_warm_up_that_fails_is_logged_and_the_version_is_served(world, monkeypatch):
    version = world.publish("hall", "1")
    cache = world.cache()

    def warm_up(served: ServedVersion) -> int:
        raise RuntimeError("no view")

    monkeypatch.setattr(world.workers, "warm_up", warm_up)
    with capture_logs() as lines:
        cache.poll()
    assert cache.served.versions == {"hall": version}
    warnings = [line for line in lines if line["log_level"] == "warning"]
    assert [(line["event"], line["version"]) for line in warnings] == [("version not warmed up", version)]
    assert "no view" in warnings[0]["error"]
    assert world.metric("firstfix_version_warm_ups_total", result="failed") == 1


def test_a_query_that_loads_a_version_does_not_wait_for_a_warm_up(world, monkeypatch):
    world.publish("hall", "1")
    cache, warmed = world.cache(), []
    monkeypatch.setattr(world.workers, "warm_up", lambda served: warmed.append(served) or 1)
    cache.get("hall")
    assert warmed == []


def test_one_poll_warms_up_a_few_maps_only(world: World, monkeypatch: pytest.MonkeyPatch):
    for number in range(map_cache.MAX_WARM_UPS + 3):
        world.publish(f"hall-{number}", "1")
    cache, warmed = world.cache(max_versions=64), []
    monkeypatch.setattr(world.workers, "warm_up", lambda served: warmed.append(served) or 1)
    cache.poll()
    assert len(cache.served.versions) == map_cache.MAX_WARM_UPS + 3
    assert len(warmed) == map_cache.MAX_WARM_UPS
