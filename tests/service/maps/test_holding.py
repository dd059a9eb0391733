from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from firstfix.catalog.rendezvous import rendezvous_order
from firstfix.errors import InvalidOption
from firstfix_service.maps.placement import Holding, open_holding
from firstfix_service.settings import Settings

MAPS = [f"map-{k}" for k in range(300)]
NAMES = ["r1", "r2", "r3", "r4"]


def held_by(name: str, names: list[str], copies: int) -> set[str]:
    return {map_id for map_id in MAPS if name in rendezvous_order(map_id, names)[:copies]}


def test_alone_it_holds_all():
    holding = Holding("r1", 2)
    holding.know(MAPS)
    assert holding.maps == set(MAPS)
    assert all(holding.is_first(map_id) for map_id in MAPS)


@pytest.mark.parametrize("copies", [1, 2, 4, 9])
def test_each_map_has_its_holders(copies: int):
    for name in NAMES:
        holding = Holding(name, copies)
        holding.see(NAMES)
        holding.know(MAPS[:100])
        holding.know(MAPS)
        assert holding.maps == held_by(name, NAMES, copies)
        assert {m for m in MAPS if holding.is_first(m)} == held_by(name, NAMES, 1)


def test_what_moves_is_told():
    holding = Holding("r1", 2)
    holding.see(NAMES)
    holding.know(MAPS)
    firsts = {m for m in MAPS if holding.is_first(m)}
    moved = holding.see(["r2", "r3"])
    before, after = held_by("r1", NAMES, 2), held_by("r1", ["r1", "r2", "r3"], 2)
    assert holding.replicas == ["r1", "r2", "r3"], "it is always one of them"
    assert moved.come == after - before != set()
    assert moved.changed - moved.come == {m for m in before if holding.is_first(m)} - firsts
    back = holding.see(NAMES)
    assert back.changed == moved.changed
    assert not back.come
    assert holding.see(NAMES).changed == set()


def test_a_map_that_is_gone_is_forgotten():
    holding = Holding("r1", 1)
    holding.know(["hall", "attic"])
    holding.forget("hall")
    holding.forget("cellar")
    holding.see(["r1"])
    assert holding.maps == {"attic"}
    assert holding.described(1) == {"copies": 1, "replicas": 1, "maps": 1, "loaded": 1}


def settings(tmp_path: Path, **changes: object) -> Settings:
    return Settings(store=str(tmp_path), **changes)


def test_the_settings_say_who_the_replicas_are(tmp_path: Path):
    assert open_holding(settings(tmp_path), "r1") is None
    named = open_holding(settings(tmp_path, holders=2, replica_names=["r2", "r1"]), "r1")
    assert named is not None
    assert (named.copies, named.replicas) == (2, ["r1", "r2"])
    shown = open_holding(settings(tmp_path, holders=1, zenoh=True), "r1")
    assert shown is not None
    assert shown.replicas == ["r1"], "until zenoh shows others"


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"holders": 2}, "who are the replicas"),
        ({"replica_names": ["r1", "r2"]}, "without FIRSTFIX_HOLDERS"),
        ({"holders": 2, "replica_names": ["r2", "r3"]}, "does not have FIRSTFIX_REPLICA, 'r1'"),
    ],
)
def test_settings_that_do_not_say_it_are_refused(tmp_path: Path, given: dict[str, object], reason: str):
    with pytest.raises(InvalidOption, match=reason):
        open_holding(settings(tmp_path, **given), "r1")


@pytest.mark.parametrize("given", [{"holders": -1}, {"holders": 65}, {"replica_names": ["a/b"]}])
def test_settings_that_mean_nothing_are_refused(tmp_path: Path, given: dict[str, object]):
    with pytest.raises(ValidationError):
        settings(tmp_path, **given)
