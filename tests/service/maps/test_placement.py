from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from firstfix.catalog.rendezvous import rendezvous_order
from firstfix.errors import InvalidOption
from firstfix_service.maps.placement import Placement, open_placement
from firstfix_service.settings import Settings

MAPS = [f"map-{k}" for k in range(300)]
NAMES = ["r1", "r2", "r3", "r4"]


def held_by(name: str, names: list[str], copies: int) -> set[str]:
    return {map_id for map_id in MAPS if name in rendezvous_order(map_id, names)[:copies]}


def test_alone_it_holds_all():
    placement = Placement("r1", 2)
    placement.add_maps(MAPS)
    assert placement.maps == set(MAPS)
    assert all(placement.is_first_holder(map_id) for map_id in MAPS)


@pytest.mark.parametrize("copies", [1, 2, 4, 9])
def test_each_map_has_its_holders(copies: int):
    for name in NAMES:
        placement = Placement(name, copies)
        placement.set_replicas(NAMES)
        placement.add_maps(MAPS[:100])
        placement.add_maps(MAPS)
        assert placement.maps == held_by(name, NAMES, copies)
        assert {m for m in MAPS if placement.is_first_holder(m)} == held_by(name, NAMES, 1)


def test_what_moves_is_told():
    placement = Placement("r1", 2)
    placement.set_replicas(NAMES)
    placement.add_maps(MAPS)
    firsts = {m for m in MAPS if placement.is_first_holder(m)}
    change = placement.set_replicas(["r2", "r3"])
    before, after = held_by("r1", NAMES, 2), held_by("r1", ["r1", "r2", "r3"], 2)
    assert placement.replicas == ["r1", "r2", "r3"], "it is always one of them"
    assert change.gained == after - before != set()
    assert change.changed - change.gained == {m for m in before if placement.is_first_holder(m)} - firsts
    back = placement.set_replicas(NAMES)
    assert back.changed == change.changed
    assert not back.gained
    assert placement.set_replicas(NAMES).changed == set()


def test_a_map_that_is_gone_is_forgotten():
    placement = Placement("r1", 1)
    placement.add_maps(["hall", "attic"])
    placement.remove_map("hall")
    placement.remove_map("cellar")
    placement.set_replicas(["r1"])
    assert placement.maps == {"attic"}
    assert placement.summary(1) == {"copies": 1, "replicas": 1, "maps": 1, "loaded": 1}


def settings(tmp_path: Path, **changes: object) -> Settings:
    return Settings(store=str(tmp_path), **changes)


def test_the_settings_say_who_the_replicas_are(tmp_path: Path):
    assert open_placement(settings(tmp_path), "r1") is None
    named = open_placement(settings(tmp_path, holders=2, replica_names=["r2", "r1"]), "r1")
    assert named is not None
    assert (named.copies, named.replicas) == (2, ["r1", "r2"])
    shown = open_placement(settings(tmp_path, holders=1, zenoh=True), "r1")
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
def test_settings_that_do_not_say_it_are_refused(tmp_path: Path, given: dict[str, object], reason: str):
    with pytest.raises(InvalidOption, match=reason):
        open_placement(settings(tmp_path, **given), "r1")


@pytest.mark.parametrize("given", [{"holders": -1}, {"holders": 65}, {"replica_names": ["a/b"]}])
def test_settings_that_mean_nothing_are_refused(tmp_path: Path, given: dict[str, object]):
    with pytest.raises(ValidationError):
        settings(tmp_path, **given)
