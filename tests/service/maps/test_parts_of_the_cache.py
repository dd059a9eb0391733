"""Parts of the map cache: order of eviction, placement, served maps, loads, and the watch of the catalog."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from pydantic import ValidationError

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.rendezvous import rendezvous_order
from firstfix.errors import InvalidOption, NotFound
from firstfix.store.store import Store, StoredObject
from firstfix_service.maps.catalog_watch import MAX_LOGS_PER_S, CatalogWatch
from firstfix_service.maps.eviction_order import EvictionOrder
from firstfix_service.maps.loaded_versions import Lease
from firstfix_service.maps.placement import Placement, open_placement
from firstfix_service.maps.served_maps import ServedMaps, SomeLeases
from firstfix_service.maps.version_files import Key
from firstfix_service.maps.version_loader import LOADERS, SharedLoads
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.settings import Settings
from firstfix_service.telemetry.metrics import Metrics
from firstfix_service.telemetry.request_scope import Requests, note
from tests.waiting import LIMIT_S, wait_until


@dataclass
class Item:
    bytes: int


def order_of(protected: set[str], *names: str) -> EvictionOrder:
    order: EvictionOrder = EvictionOrder(lambda key: key[0] in protected)
    for size, name in enumerate(names, 1):
        order.add(key(name), Item(size))
    return order


def key(name: str) -> Key:
    return name, "v"


def names(order: EvictionOrder) -> str:
    return "".join(name for name, _ in order)


def test_the_least_recently_used_is_evicted_first():
    order = order_of(set(), *"abc")
    assert order.use(key("a")) == Item(1)
    assert names(order) == "bca"
    assert order.use(key("d")) is None
    assert len(order) == 3


def test_protected_versions_are_evicted_last():
    order = order_of(set("ac"), *"abcd")
    assert names(order) == "bdac"
    order.use(key("a"))
    order.use(key("b"))
    assert names(order) == "dbca"
    assert (order.protected, order.protected_bytes, order.bytes) == (2, 4, 10)


def test_bytes_are_summed_over_the_present_versions():
    order = order_of(set("ac"), *"abcd")
    assert order.pop(key("c")) == Item(3)
    assert order.pop(key("b")) == Item(2)
    assert (order.protected, order.protected_bytes, order.bytes) == (1, 1, 5)
    assert key("b") not in order
    assert key("a") in order


def test_a_new_choice_of_protected_versions_counts_after_reclassifying():
    protected = set("ac")
    order = order_of(protected, *"abcd")
    protected ^= set("ab")
    order.reclassify()
    assert names(order) == "dacb"
    assert (order.protected, order.protected_bytes, order.bytes) == (2, 5, 10)


HALLS = [f"map-{k}" for k in range(300)]
NAMES = ["r1", "r2", "r3", "r4"]


def held_by(name: str, names: list[str], copies: int) -> set[str]:
    return {map_id for map_id in HALLS if name in rendezvous_order(map_id, names)[:copies]}


def test_a_single_replica_holds_all_maps():
    placement = Placement("r1", 2)
    placement.add_maps(HALLS)
    assert placement.maps == set(HALLS)
    assert all(placement.is_first_holder(map_id) for map_id in HALLS)


@pytest.mark.parametrize("copies", [1, 2, 4, 9])
def test_each_map_has_as_many_holders_as_configured(copies: int):
    for name in NAMES:
        placement = Placement(name, copies)
        placement.set_replicas(NAMES)
        placement.add_maps(HALLS[:100])
        placement.add_maps(HALLS)
        assert placement.maps == held_by(name, NAMES, copies)
        assert {m for m in HALLS if placement.is_first_holder(m)} == held_by(name, NAMES, 1)


def test_a_change_of_replicas_lists_the_maps_that_move():
    placement = Placement("r1", 2)
    placement.set_replicas(NAMES)
    placement.add_maps(HALLS)
    firsts = {m for m in HALLS if placement.is_first_holder(m)}
    change = placement.set_replicas(["r2", "r3"])
    before, after = held_by("r1", NAMES, 2), held_by("r1", ["r1", "r2", "r3"], 2)
    assert placement.replicas == ["r1", "r2", "r3"], "it is always one of them"
    assert change.gained == after - before != set()
    assert change.changed - change.gained == {m for m in before if placement.is_first_holder(m)} - firsts
    back = placement.set_replicas(NAMES)
    assert back.changed == change.changed
    assert not back.gained
    assert placement.set_replicas(NAMES).changed == set()


def test_a_removed_map_is_forgotten():
    placement = Placement("r1", 1)
    placement.add_maps(["hall", "attic"])
    placement.remove_map("hall")
    placement.remove_map("cellar")
    placement.set_replicas(["r1"])
    assert placement.maps == {"attic"}
    assert placement.summary(1) == {"copies": 1, "replicas": 1, "maps": 1, "loaded": 1}


def placed(tmp_path: Path, **changes: object) -> Settings:
    return Settings(store=str(tmp_path), **changes)


def test_replicas_can_be_named_in_the_settings(tmp_path: Path):
    assert open_placement(placed(tmp_path), "r1") is None
    named = open_placement(placed(tmp_path, holders=2, replica_names=["r2", "r1"]), "r1")
    assert named is not None
    assert (named.copies, named.replicas) == (2, ["r1", "r2"])
    shown = open_placement(placed(tmp_path, holders=1, zenoh=True), "r1")
    assert shown is not None
    assert shown.replicas == ["r1"], "until zenoh shows others"


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"holders": 2}, "the replicas are unknown"),
        ({"replica_names": ["r1", "r2"]}, "without FIRSTFIX_HOLDERS"),
        ({"holders": 2, "replica_names": ["r2", "r3"]}, "does not contain FIRSTFIX_REPLICA, 'r1'"),
    ],
)
def test_incomplete_settings_of_replicas_are_refused(tmp_path: Path, given: dict[str, object], reason: str):
    with pytest.raises(InvalidOption, match=reason):
        open_placement(placed(tmp_path, **given), "r1")


@pytest.mark.parametrize("given", [{"holders": -1}, {"holders": 65}, {"replica_names": ["a/b"]}])
def test_invalid_settings_of_replicas_are_refused(tmp_path: Path, given: dict[str, object]):
    with pytest.raises(ValidationError):
        placed(tmp_path, **given)


@pytest.fixture
def maps() -> ServedMaps:
    return ServedMaps(None, None, Metrics())  # type: ignore[arg-type]


def test_published_maps_and_their_serving_versions_are_listed(maps: ServedMaps) -> None:
    maps.add({"b", "a"})
    assert maps.serve("c", "v1", is_active=True) is None
    assert maps.serve("c", "v2", is_active=True) == "v1"
    assert maps.ids == ["a", "b", "c"]
    assert len(maps) == 3
    assert "b" in maps
    assert "d" not in maps
    assert maps.versions == {"c": "v2"}
    assert maps.version("c") == "v2"
    assert maps.version("a") is None


def test_a_map_is_behind_until_its_active_version_answers(maps: ServedMaps) -> None:
    maps.serve("a", "old", is_active=False)
    assert maps.is_behind("a")
    maps.serve("a", "new", is_active=True)
    assert not maps.is_behind("a")
    maps.serve("a", "old", is_active=False)
    maps.forget("a")
    assert not maps.is_behind("a")
    assert "a" not in maps
    assert maps.version("a") is None


def test_a_changed_map_is_returned_once(maps: ServedMaps) -> None:
    maps.add({"a", "b"})
    maps.serve("c", "v1", is_active=True)
    maps.forget("a")
    maps.touch(["d"])
    assert maps.take_touched() == {"a", "b", "c", "d"}
    assert maps.take_touched() == set()


class Held(Lease):
    """A lease that knows how often it was closed."""

    def __init__(self, map_id: str) -> None:
        self.closed = 0
        super().__init__(ServedVersion(map_id, "v", Path()), self._count, lambda: self)

    def _count(self) -> None:
        self.closed += 1


def names_of(some: SomeLeases) -> list[str]:
    return [one.map_id for one in some.future.result(0).served]


def test_some_leases_omit_maps_that_cannot_be_served() -> None:
    futures: list[Future[Lease]] = [Future() for _ in range(3)]
    some = SomeLeases(futures)
    futures[2].set_result(Held("c"))
    futures[0].set_exception(NotFound("no map a"))
    assert not some.future.done()
    futures[1].set_result(Held("b"))
    assert names_of(some) == ["b", "c"]


def test_some_leases_raise_if_no_map_can_be_served() -> None:
    futures: list[Future[Lease]] = [Future(), Future()]
    some = SomeLeases(futures)
    for future, name in zip(futures, "ab", strict=True):
        future.set_exception(NotFound(f"no map {name}"))
    with pytest.raises(NotFound, match="no map a"):
        some.future.result(0)


def test_settled_leases_release_late_ones() -> None:
    futures: list[Future[Lease]] = [Future(), Future(), Future()]
    some = SomeLeases(futures)
    some.settle()
    assert not some.future.done(), "nothing is there yet"
    early, late = Held("b"), Held("a")
    futures[1].set_result(early)
    some.settle()
    assert names_of(some) == ["b"]
    futures[0].set_result(late)
    futures[2].set_exception(NotFound("no map c"))
    some.settle()
    assert (early.closed, late.closed) == (0, 1)
    some.future.result(0).close()
    assert early.closed == 1


class Loads:
    """Loads that wait for a gate."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.gate = threading.Event()
        self.shared = SharedLoads(self._load)

    def request(self, caller: str, map_id: str) -> Future[Lease]:
        with Requests().scope("http", None, request_id="", traceparent=None, started=time.monotonic()):
            note(caller=caller)
            return self.shared.request(map_id, None)

    def _load(self, map_id: str, version: str | None) -> Lease:
        self.begun.append(map_id)
        assert self.gate.wait(LIMIT_S)
        if map_id == "missing":
            raise NotFound("no such map")
        return _lease(map_id)


def _lease(map_id: str) -> Lease:
    return Lease(ServedVersion(map_id, "v", Path()), lambda: None, lambda: _lease(map_id))


@pytest.fixture
def loads() -> Iterator[Loads]:
    with _closed(Loads()) as these:
        yield these


@contextmanager
def _closed(loads: Loads) -> Iterator[Loads]:
    try:
        yield loads
    finally:
        loads.gate.set()
        loads.shared.close()


def test_cold_maps_of_one_caller_do_not_hold_up_another(loads: Loads):
    many = [loads.request("flood", f"cold-{number}") for number in range(30)]
    wait_until(lambda: len(loads.begun) == LOADERS - 1)
    one = loads.request("robot", "hall")
    wait_until(lambda: "hall" in loads.begun)
    loads.gate.set()
    assert [future.result(LIMIT_S).served.map_id for future in (*many, one)][-1] == "hall"
    assert sorted(loads.begun) == sorted({*loads.begun}), "each is loaded once"


def test_a_shared_load_begins_at_the_first_turn_of_any_of_its_callers(loads: Loads):
    many = [loads.request("flood", f"cold-{number}") for number in range(30)]
    wait_until(lambda: len(loads.begun) == LOADERS - 1)
    same = loads.request("robot", "cold-29")
    wait_until(lambda: "cold-29" in loads.begun)
    loads.gate.set()
    for future in (*many, same):
        future.result(LIMIT_S)
    assert loads.begun.count("cold-29") == 1


def test_a_failed_load_fails_for_all_its_callers_and_is_tried_again(loads: Loads):
    asked = [loads.request(caller, "missing") for caller in ("a", "b", "a")]
    loads.gate.set()
    for future in asked:
        with pytest.raises(NotFound):
            future.result(LIMIT_S)
    with pytest.raises(NotFound):
        loads.request("a", "missing").result(LIMIT_S)
    assert loads.begun == ["missing", "missing"]


def test_close_waits_only_for_loads_that_have_begun():
    with _closed(Loads()) as loads:
        many = [loads.request("flood", f"cold-{number}") for number in range(30)]
        wait_until(lambda: len(loads.begun) == LOADERS - 1)
        threading.Timer(0.05, loads.gate.set).start()
        loads.shared.close()
        assert sum(future.done() for future in many) == LOADERS - 1 == len(loads.begun)


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
def many_maps() -> Catalog:
    store = Counts.open("memory://")
    assert isinstance(store, Counts)
    store.calls = Counter()
    for k in range(MAPS):
        store.put_new(f"maps/map-{k:04}/log/000001.json", b"{}")
    return Catalog(store)


def test_thousands_of_maps_cost_a_few_calls_a_poll(many_maps: Catalog):
    watch = CatalogWatch(many_maps, interval_s=2, sweep_s=1200)
    names, listed = watch.poll()
    assert len(names) == MAPS
    assert listed == set(names)
    seen: set[str] = set()
    assert isinstance(many_maps.store, Counts)
    for _ in range(600):
        many_maps.store.calls.clear()
        names, _ = watch.poll()
        assert len(names) == MAPS / 600, "logs that are then read"
        assert sum(many_maps.store.calls.values()) <= 4
        seen.update(names)
    assert len(seen) == MAPS


def test_the_logs_read_a_second_are_bounded(many_maps: Catalog):
    watch = CatalogWatch(many_maps, interval_s=2, sweep_s=60)
    watch.poll()
    polls = [watch.poll()[0] for _ in range(MAPS // (2 * MAX_LOGS_PER_S))]
    assert {len(names) for names in polls} == {2 * MAX_LOGS_PER_S}, "30 polls would have to read 100 each"
    assert len({name for names in polls for name in names}) == MAPS, "and each has its turn"


def test_a_notice_is_followed_at_the_next_poll(many_maps: Catalog):
    many_maps.changes.note("map-0007")
    watch = CatalogWatch(many_maps, interval_s=2, sweep_s=1200)
    watch.poll()
    watch.poll()
    writer = Catalog(many_maps.store)
    writer.changes.note("map-2999")
    writer.changes.note("brand-new")
    names, _ = watch.poll()
    assert names[:2] == ["map-2999", "brand-new"]
    assert "brand-new" not in watch.poll()[0]


def test_with_few_maps_each_poll_reads_all():
    many_maps = Catalog(Store.open("memory://"))
    watch = CatalogWatch(many_maps, interval_s=2, sweep_s=60)
    assert watch.poll() == ([], frozenset())
    many_maps.store.put_new("maps/attic/log/000001.json", b"{}")
    assert watch.poll() == (["attic"], {"attic"})
    assert watch.poll()[0] == ["attic"]


def test_after_a_reset_all_maps_are_read(many_maps: Catalog):
    watch = CatalogWatch(many_maps, interval_s=2, sweep_s=1200)
    watch.poll()
    watch.poll()
    watch.reset()
    assert len(watch.poll()[0]) == MAPS
