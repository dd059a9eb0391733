"""State of the served maps, kept without asking the store."""

from __future__ import annotations

from concurrent.futures import Future
from pathlib import Path

import pytest

from firstfix.errors import NotFound
from firstfix_service.maps.loaded_versions import Lease
from firstfix_service.maps.served_maps import ServedMaps, SomeLeases
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.telemetry.metrics import Metrics


@pytest.fixture
def maps() -> ServedMaps:
    return ServedMaps(None, None, Metrics())  # type: ignore[arg-type]


def test_published_maps_and_serving_versions(maps: ServedMaps) -> None:
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


def test_touched_maps_are_returned_once(maps: ServedMaps) -> None:
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


def test_some_leases_leave_out_the_maps_that_cannot_be_served() -> None:
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


def test_some_leases_go_on_with_what_is_there_and_give_back_what_comes_late() -> None:
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
