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
from tests.core.fixtures import make_version, publish


def test_the_full_version_takes_the_place_of_a_provisional_one(any_catalog: Catalog, tmp_path: Path):
    early = publish(any_catalog, tmp_path, "early", provisional=True, build_id="b1")
    (info,) = any_catalog.versions("hall")
    assert (info.version, info.active, info.provisional) == (early, True, True)
    assert any_catalog.manifest("hall", early).provisional
    assert not any_catalog.state("hall").has_full
    full = publish(any_catalog, tmp_path, "full", build_id="b1")
    (info,) = any_catalog.versions("hall")
    assert (info.version, info.active, info.provisional) == (full, True, False)
    assert any_catalog.state("hall").has_full
    with pytest.raises(Conflict):
        any_catalog.roll_back("hall")
    later = any_catalog.store.now() + timedelta(days=2)
    removed = any_catalog.collect_garbage("hall", now=later)
    assert removed
    assert all(early in key for key in removed)
    before = any_catalog.log("hall")
    publish(any_catalog, tmp_path, "early", provisional=True, build_id="b1")
    publish(any_catalog, tmp_path, "full", build_id="b1")
    assert any_catalog.log("hall") == before, "a repeated build changes nothing"


def test_a_provisional_version_never_takes_a_full_ones_place(any_catalog: Catalog, tmp_path: Path):
    full = publish(any_catalog, tmp_path, "full")
    before = any_catalog.log("hall"), any_catalog.store.list()
    publish(any_catalog, tmp_path, "early", provisional=True)
    assert (any_catalog.log("hall"), any_catalog.store.list()) == before
    assert any_catalog.active_version("hall") == full


def test_a_provisional_version_gives_way_to_a_full_one_that_came_meanwhile(tmp_path: Path):
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    manifest = make_version(tmp_path / "early", provisional=True)

    def meanwhile(done: float) -> None:
        if not catalog.state("hall").published:
            publish(Catalog(catalog.store), tmp_path, "full")

    catalog.publish("hall", tmp_path / "early", manifest, on_progress=meanwhile)
    (info,) = catalog.versions("hall")
    assert (info.active, info.provisional) == (True, False)


def test_a_newer_provisional_version_replaces_an_older_one(any_catalog: Catalog, tmp_path: Path):
    publish(any_catalog, tmp_path, "early", provisional=True, build_id="b1")
    second = publish(any_catalog, tmp_path, "second", provisional=True, build_id="b2")
    assert any_catalog.active_version("hall") == second
    assert any_catalog.state("hall").provisional == {info.version for info in any_catalog.versions("hall")}
    full = publish(any_catalog, tmp_path, "full", build_id="b2")
    assert [info.version for info in any_catalog.versions("hall")] == [full]


def test_snapshots_and_entries_keep_what_is_provisional(any_catalog: Catalog, tmp_path: Path):
    early = publish(any_catalog, tmp_path, "early", provisional=True)
    state = any_catalog.state("hall")
    again = MapState.parse(state.last_seq, json.loads(state.to_json()))
    assert again == state
    assert again.provisional == {early}
    damaged = json.loads(state.to_json())
    damaged["entries"][0]["provisional"] = "yes"
    with pytest.raises(TypeError):
        MapState.parse(state.last_seq, damaged)


def test_only_manifests_of_provisional_versions_say_so():
    assert "provisional" not in json.loads(Manifest({}).to_json())
    early = Manifest({}, provisional=True)
    assert Manifest.from_json(early.to_json()) == early
    for wrong in (early.to_json().replace(b"true", b"1"), early.to_json().replace(b"true", b"false")):
        with pytest.raises(CorruptVersion):
            Manifest.from_json(wrong)
