"""A provisional version serves a map until its full one is there, and never takes a full one's place."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_state import MapState
from firstfix.catalog.manifest import Manifest
from firstfix.errors import Conflict, CorruptVersion
from firstfix.store.store import Store


@pytest.fixture
def catalog(any_store_url: str) -> Catalog:
    return Catalog(Store.open(any_store_url))


def publish(
    catalog: Catalog, folder: Path, content: str, *, provisional: bool = False, build: str = ""
) -> str:
    (folder / content).mkdir(parents=True, exist_ok=True)
    (folder / content / "a.bin").write_bytes(content.encode())
    manifest = Manifest.for_directory(folder / content, provisional=provisional)
    return catalog.publish("hall", folder / content, manifest, build_id=build)


def test_the_full_version_takes_its_place(catalog: Catalog, tmp_path: Path) -> None:
    early = publish(catalog, tmp_path, "early", provisional=True, build="b1")
    (info,) = catalog.versions("hall")
    assert (info.version, info.active, info.provisional) == (early, True, True)
    assert catalog.manifest("hall", early).provisional
    assert not catalog.state("hall").has_full
    full = publish(catalog, tmp_path, "full", build="b1")
    (info,) = catalog.versions("hall")
    assert (info.version, info.active, info.provisional) == (full, True, False)
    assert catalog.state("hall").has_full
    with pytest.raises(Conflict):
        catalog.roll_back("hall")
    later = catalog.store.now() + timedelta(days=2)
    removed = catalog.collect_garbage("hall", now=later)
    assert removed
    assert all(early in key for key in removed)
    before = catalog.log("hall")
    publish(catalog, tmp_path, "early", provisional=True, build="b1")
    publish(catalog, tmp_path, "full", build="b1")
    assert catalog.log("hall") == before, "a repeated build changes nothing"


def test_it_never_takes_a_full_versions_place(catalog: Catalog, tmp_path: Path) -> None:
    full = publish(catalog, tmp_path, "full")
    before = catalog.log("hall"), catalog.store.list()
    publish(catalog, tmp_path, "early", provisional=True)
    assert (catalog.log("hall"), catalog.store.list()) == before
    assert catalog.active_version("hall") == full


def test_it_gives_way_to_a_full_version_that_came_while_its_files_were_put(tmp_path: Path) -> None:
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    (tmp_path / "early").mkdir()
    (tmp_path / "early" / "a.bin").write_bytes(b"early")
    manifest = Manifest.for_directory(tmp_path / "early", provisional=True)

    def meanwhile(done: float) -> None:
        if not catalog.state("hall").published:
            publish(Catalog(catalog.store), tmp_path, "full")

    catalog.publish("hall", tmp_path / "early", manifest, on_progress=meanwhile)
    (info,) = catalog.versions("hall")
    assert (info.active, info.provisional) == (True, False)


def test_a_newer_one_takes_the_place_of_an_older_one(catalog: Catalog, tmp_path: Path) -> None:
    publish(catalog, tmp_path, "early", provisional=True, build="b1")
    second = publish(catalog, tmp_path, "second", provisional=True, build="b2")
    assert catalog.active_version("hall") == second
    assert catalog.state("hall").provisional == {info.version for info in catalog.versions("hall")}
    full = publish(catalog, tmp_path, "full", build="b2")
    assert [info.version for info in catalog.versions("hall")] == [full]


def test_snapshots_and_entries_keep_it(catalog: Catalog, tmp_path: Path) -> None:
    early = publish(catalog, tmp_path, "early", provisional=True)
    state = catalog.state("hall")
    again = MapState.parse(state.last_seq, json.loads(state.to_json()))
    assert again == state
    assert again.provisional == {early}
    damaged = json.loads(state.to_json())
    damaged["entries"][0]["provisional"] = "yes"
    with pytest.raises(TypeError):
        MapState.parse(state.last_seq, damaged)


def test_manifests_of_full_versions_are_as_they_were() -> None:
    assert "provisional" not in json.loads(Manifest({}).to_json())
    early = Manifest({}, provisional=True)
    assert Manifest.from_json(early.to_json()) == early
    for wrong in (early.to_json().replace(b"true", b"1"), early.to_json().replace(b"true", b"false")):
        with pytest.raises(CorruptVersion):
            Manifest.from_json(wrong)
