"""The coarse index follows the catalog, and says which maps a query without a map searches."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.engine.config import OccupancyConfig
from firstfix.engine.map_choice.sought_scan import SoughtScan
from firstfix.errors import Overloaded, StoreUnavailable
from firstfix.store.store import Store
from firstfix_service.maps import coarse_maps
from firstfix_service.maps.coarse_maps import CoarseMaps
from firstfix_service.query_workers.query import CHOSEN_MAPS, MAX_MAPS
from firstfix_service.telemetry.metrics import Metrics
from tests.waiting import let_pass, wait_until

CONFIG = OccupancyConfig(rings=4, sectors=16, max_range_m=20.0, layer_edges_m=(0.3, 1.0))
NAMES = [f"m{k:02}" for k in range(MAX_MAPS + 4)]


def occupancy(name: str, label: int = 0) -> np.ndarray:
    rng = np.random.default_rng([*name.encode(), label])
    return np.packbits(rng.uniform(size=(6, 64)) < 0.4, axis=1)


def scan_of(name: str, label: int = 0) -> SoughtScan:
    return SoughtScan({CONFIG.model_dump_json(): ({"occupancy": occupancy(name, label)[2:3]},)})


class World:
    def __init__(self, tmp_path: Path) -> None:
        self.catalog = Catalog(Store.open(str(tmp_path / "store")))
        self.scratch = tmp_path / "made"
        self.metrics = Metrics()
        self.coarse = CoarseMaps(self.catalog, tmp_path / "coarse", self.metrics)

    def publish(self, name: str, label: int = 0, bits: np.ndarray | None = None) -> str:
        directory = self.scratch / f"{name}-{label}"
        directory.mkdir(parents=True)
        (directory / "engine.json").write_text(json.dumps({"descriptor": CONFIG.model_dump()}))
        np.save(directory / "template_position_m.npy", np.random.default_rng(1).uniform(size=(6, 3)))
        np.save(directory / "template_occupancy.npy", occupancy(name, label) if bits is None else bits)
        return self.catalog.publish(name, directory, Manifest.for_directory(directory))

    def follow(self, *names: str) -> None:
        self.coarse.follow({name: self.catalog.active_version(name) for name in names})

    def held(self, count: int) -> bool:
        return self.metrics.registry.get_sample_value("firstfix_coarse_maps") == count


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    world = World(tmp_path)
    for name in NAMES:
        world.publish(name)
    yield world
    world.coarse.close()


def test_few_maps_need_no_coarse_index(world: World):
    world.coarse.start()
    world.follow(*NAMES[:MAX_MAPS])
    let_pass(0.3)
    assert world.coarse.forms == ()
    world.follow(*NAMES)
    wait_until(lambda: world.held(len(NAMES)))
    assert world.coarse.choose(scan_of("m03"), NAMES)[0] == "m03"
    world.coarse.follow(dict.fromkeys(NAMES[2:]))
    wait_until(lambda: world.held(0))


def test_the_index_follows_versions_and_removals(world: World):
    world.coarse.start()
    world.follow(*NAMES)
    wait_until(lambda: world.held(len(NAMES)))
    chosen = world.coarse.choose(scan_of("m07"), NAMES)
    assert (chosen[0], len(chosen)) == ("m07", CHOSEN_MAPS)
    assert set(world.coarse.choose(scan_of("m07"), NAMES[:3])) == set(NAMES[:3])
    world.publish("m07", 1)
    world.follow("m07")
    wait_until(lambda: world.coarse.choose(scan_of("m07", 1), NAMES)[0] == "m07")
    world.coarse.follow({"m07": None})
    wait_until(lambda: world.held(len(NAMES) - 1))
    left = [name for name in NAMES if name != "m07"]
    assert "m07" not in world.coarse.choose(scan_of("m07", 1), left)


def test_unread_maps_are_overloaded_or_searched_beside(world: World):
    world.follow(*NAMES)
    with pytest.raises(Overloaded, match=f"{len(NAMES)} of {len(NAMES)} maps"):
        world.coarse.choose(SoughtScan({}), NAMES)
    assert set(world.coarse.choose(SoughtScan({}), NAMES[:CHOSEN_MAPS])) == set(NAMES[:CHOSEN_MAPS])
    world.coarse.start()
    wait_until(lambda: world.held(len(NAMES)))
    new = ["n1", "n2"]  # not read yet: they are searched beside the others
    assert set(new) <= set(world.coarse.choose(scan_of("m03"), [*NAMES, *new]))


def test_a_damaged_version_keeps_no_other_map_away(world: World):
    world.publish("damaged", bits=occupancy("damaged")[:2])
    world.coarse.start()
    world.follow("damaged", *NAMES)
    wait_until(lambda: world.held(len(NAMES)))
    chosen = world.coarse.choose(scan_of("m03"), ["damaged", *NAMES])
    assert chosen[0] == "m03"
    assert "damaged" not in chosen


def test_a_map_with_too_many_templates_is_searched_beside_the_others(world: World, monkeypatch):
    world.publish("large", bits=np.zeros((6, 900), np.uint8))
    monkeypatch.setattr(coarse_maps, "MAX_FILE_BYTES", 4096)
    world.coarse.start()
    world.follow("large", *NAMES)
    wait_until(lambda: world.held(len(NAMES)))
    assert "large" in world.coarse.choose(scan_of("m03"), ["large", *NAMES])


def test_a_store_that_fails_is_asked_again(world: World, monkeypatch):
    monkeypatch.setattr(coarse_maps, "STORE_AGAIN_S", 0.1)
    read = world.catalog.read_file

    def fail(*_: object, **__: object) -> bytes:
        raise StoreUnavailable("no answer")

    monkeypatch.setattr(world.catalog, "read_file", fail)
    world.coarse.start()
    world.follow(*NAMES)
    let_pass(0.3)
    with pytest.raises(Overloaded):
        world.coarse.choose(SoughtScan({}), NAMES)
    monkeypatch.setattr(world.catalog, "read_file", read)
    wait_until(lambda: world.held(len(NAMES)))
