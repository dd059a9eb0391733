"""Damage in the store: the map goes on with what is right, or the answer says what is damaged."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from firstfix.errors import FirstfixError, NotFound, WorkerLost
from firstfix.maintenance.repair import Repair
from firstfix.maintenance.verify import Verification
from firstfix.store.store import Store
from tests.service.cache_world import World
from tests.service.service_world import Service, publish, serving
from tests.waiting import wait_until


def damage(service: Service, tmp_path: Path, version: str) -> None:
    """One wrong bit, with the times of the right file: bits rot without a trace."""
    path = tmp_path / "store" / "maps" / "hall" / "versions" / version / "label.txt"
    times = path.stat()
    path.write_text(chr(ord(path.read_text()[0]) ^ 1) + path.read_text()[1:])
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


@serving(zenoh=False, maps={})
@pytest.mark.parametrize("error", [IndexError("out of bounds"), WorkerLost("two worker processes died")])
def test_a_query_that_fails_on_a_damaged_file_is_corrupt_version(
    service: Service, tmp_path: Path, error: Exception
):
    first = publish(service.catalog, "hall", "1", service.scratch)
    second = publish(service.catalog, "hall", "2", service.scratch)
    assert first != second
    wait_until(lambda: service.ask_http().x == 2)
    damage(service, tmp_path, second)
    assert service.ask_http().x == 2, "it is in memory, and nobody has looked"
    service.behaviour.raises = error
    reply = service.ask_http()
    assert reply.json["code"] == "corrupt_version"
    assert "label.txt" in reply.json["detail"]
    service.behaviour.raises = None
    assert service.ask_http().x == 1, "the version before"


@serving(zenoh=False, maps={})
def test_a_query_that_fails_on_undamaged_files_is_not_called_corrupt(service: Service):
    publish(service.catalog, "hall", "1", service.scratch)
    for error, code in (
        (IndexError("a defect"), FirstfixError.code),
        (WorkerLost("two worker processes died"), WorkerLost.code),
    ):
        service.behaviour.raises = error
        assert service.ask_http().json["code"] == code
    service.behaviour.raises = None
    assert service.ask_http().x == 1
    assert service.behaviour.loads == ["1"], "it stays in memory"


def entry(tmp_path: Path, number: int) -> Path:
    return tmp_path / "store" / "maps" / "hall" / "log" / f"{number:06d}.json"


def restart(world: World, tmp_path: Path) -> World:
    """A process that reads the store for the first time."""
    return World(tmp_path, Store.open(str(tmp_path / "store")))


def test_an_activation_with_one_flipped_bit_is_read_and_repaired(world: World, tmp_path: Path):
    world.publish("hall", "1")
    second = world.publish("hall", "2")
    path = entry(tmp_path, 4)
    right = path.read_bytes()
    for bit in (8 * right.index(b"activated") + 8 * 8, *random.Random(1).sample(range(8 * len(right)), 6)):
        flipped = bytearray(right)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        later = restart(world, tmp_path)
        assert later.cache().get("hall").version == second, bytes(flipped)
        found = Verification(later.catalog.store).run().damaged
        assert [one.key for one in found] == ["maps/hall/log/000004.json"] or b'"checksum"' not in flipped
    assert Verification(world.catalog.store, repair=Repair(world.catalog.store)).run().damaged == []
    assert path.read_bytes() == right


def test_a_running_replica_serves_its_version_without_an_activation_record(world: World, tmp_path: Path):
    version = world.publish("hall", "1")
    cache = world.cache()
    cache.poll()
    path = entry(tmp_path, 2)
    path.write_bytes(path.read_bytes()[:-40])
    cache.poll()
    assert cache.refresh("hall").version == version


def test_a_map_without_a_readable_activation_names_the_damage(world: World, tmp_path: Path):
    world.publish("hall", "1")
    path = entry(tmp_path, 2)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(NotFound, match="in its log these entries are damaged or missing: 2 "):
        restart(world, tmp_path).cache().get("hall")
