"""Damage in a map's log: the map goes on where one bit has flipped, or the answer says what happened."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from firstfix.errors import NotFound
from firstfix.maintenance.repair import Repair
from firstfix.maintenance.verify import Verification
from firstfix.store.store import Store
from tests.service.cache_world import World


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, Store.open(str(tmp_path / "store")))


def entry(tmp_path: Path, number: int) -> Path:
    return tmp_path / "store" / "maps" / "hall" / "log" / f"{number:06d}.json"


def restart(world: World, tmp_path: Path) -> World:
    """A process that reads the store for the first time."""
    return World(tmp_path, Store.open(str(tmp_path / "store")))


def test_an_activation_with_one_flipped_bit_still_counts(world: World, tmp_path: Path):
    world.publish("hall", "1")
    second = world.publish("hall", "2")
    path = entry(tmp_path, 4)
    right = path.read_bytes()
    assert b'"event": "activated"' in right
    bits = [8 * right.index(b"activated") + 8 * 8, *random.Random(1).sample(range(8 * len(right)), 6)]
    for bit in bits:
        flipped = bytearray(right)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        later = restart(world, tmp_path)
        assert later.cache().get("hall").version == second, bytes(flipped)
        found = Verification(later.catalog.store).run().damaged
        assert [one.key for one in found] == ["maps/hall/log/000004.json"] or b'"checksum"' not in flipped
    assert Verification(world.catalog.store, repair=Repair(world.catalog.store)).run().damaged == []
    assert path.read_bytes() == right


def test_an_event_that_no_release_knows_is_damage(world: World, tmp_path: Path):
    first = world.publish("hall", "1")
    world.publish("hall", "2")
    path = entry(tmp_path, 4)  # with more than one wrong bit
    path.write_bytes(path.read_bytes().replace(b'"activated"', b'"activbtee"'))
    later = restart(world, tmp_path)
    unreadable = []
    later.catalog.store.unreadable.listen(unreadable.append)
    assert later.cache().get("hall").version == first, "the last version whose activation can be read"
    assert [one.key for one in unreadable] == ["maps/hall/log/000004.json"]
    assert [one.key for one in Verification(later.catalog.store).run().damaged] == [
        "maps/hall/log/000004.json"
    ]


def test_a_lost_activation_takes_nothing_from_a_running_replica(world: World, tmp_path: Path):
    version = world.publish("hall", "1")
    cache = world.cache()
    cache.poll()
    path = entry(tmp_path, 2)
    path.write_bytes(path.read_bytes()[:-40])
    cache.poll()
    assert cache.refresh("hall").version == version


def test_a_map_without_a_readable_activation_says_why(world: World, tmp_path: Path):
    world.publish("hall", "1")
    path = entry(tmp_path, 2)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(NotFound, match="in its log these entries are damaged or missing: 2 "):
        restart(world, tmp_path).cache().get("hall")
