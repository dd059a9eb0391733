from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.builds.callers import CallersKey, claim_build
from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source, source_key
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.maintenance.garbage import Ages, collect_garbage, remove_abandoned
from firstfix.store.store import Store
from tests.frequent_snapshots import EVERY
from tests.waiting import let_pass

NOW = Ages(things_s=-5, builds_s=-5)  # whatever its age


def publish(catalog: Catalog, tmp_path: Path, content: str, map_id: str = "hall") -> str:
    folder = tmp_path / content
    folder.mkdir(exist_ok=True)
    (folder / "a.txt").write_text(content)
    return catalog.publish(map_id, folder, Manifest.for_directory(folder))


def build(catalog: Catalog, tmp_path: Path, build_id: str, state: str, version: str | None = None) -> str:
    """Records a build and puts its source. Returns the key of the source."""
    path = tmp_path / f"{build_id}.ply"
    path.write_text(build_id)
    key = source_key("hall", put_source(catalog.store, "hall", path))
    catalog.builds.put(build_id, {"map_id": "hall", "source": {"key": key}, "trajectory": None, "config": {}})
    catalog.builds.set_status(build_id, new_status(state, map_id="hall", version=version))
    return key


@pytest.fixture
def catalog(any_store_url: str) -> Catalog:
    return Catalog(Store.open(any_store_url))


def test_what_is_served_can_be_built_again(catalog: Catalog, tmp_path: Path):
    served, retired = publish(catalog, tmp_path, "served"), publish(catalog, tmp_path, "retired")
    catalog.retire("hall", retired, force=True)
    kept = {
        build(catalog, tmp_path, "b-served", "succeeded", served),
        build(catalog, tmp_path, "b-waits", "queued"),
        build(catalog, tmp_path, "b-runs", "running"),
    }
    build(catalog, tmp_path, "b-retired", "succeeded", retired)
    build(catalog, tmp_path, "b-failed", "failed")
    catalog.store.put(source_key("hall", "0" * 64), b"of a service that was killed")
    Uploads(catalog.store).create("u1", size_bytes=3, file_name="x")
    claim_build(catalog.store, CallersKey("key:a", "key"), "f", "b-served")
    catalog.store.put("probe/abc", b"first")
    before = set(catalog.store.list())
    would = collect_garbage(catalog, ages=NOW, dry_run=True)
    assert set(catalog.store.list()) == before
    done = collect_garbage(catalog, ages=NOW)
    assert done == would
    assert before - set(catalog.store.list()) == {key for keys in done.keys.values() for key in keys}
    assert set(catalog.store.list("maps/hall/sources")) == kept
    assert catalog.builds.ids() == ["b-runs", "b-served", "b-waits"]
    assert catalog.store.list("uploads") == catalog.store.list("idempotency") == []
    assert catalog.store.list("probe") == []
    assert catalog.manifest("hall", served)
    assert collect_garbage(catalog, ages=NOW).count == 0


def test_nothing_young_is_touched(catalog: Catalog, tmp_path: Path):
    publish(catalog, tmp_path, "one")
    build(catalog, tmp_path, "b-failed", "failed")
    catalog.store.put(source_key("hall", "0" * 64), b"being posted")
    Uploads(catalog.store).create("u1", size_bytes=3, file_name="x")
    claim_build(catalog.store, CallersKey("key:a", "key"), "f", "b1")
    assert collect_garbage(catalog).count == 0
    assert remove_abandoned(catalog).count == 0


def test_a_failed_builds_record_outlives_its_day_but_not_its_month(catalog: Catalog, tmp_path: Path):
    key = build(catalog, tmp_path, "b-failed", "failed")
    waiting = build(catalog, tmp_path, "b-waiting", "queued")
    done = collect_garbage(catalog, ages=Ages(things_s=-5))
    assert done.keys["sources"] == [key], "nothing was made of it"
    assert done.count == 1
    done = collect_garbage(catalog, ages=NOW)
    assert len(done.keys["builds"]) == 2
    assert catalog.store.exists(waiting)


def test_one_map_alone(catalog: Catalog, tmp_path: Path):
    for map_id in ("hall", "attic"):
        version = publish(catalog, tmp_path, "gone", map_id)
        catalog.retire(map_id, version, force=True)
        catalog.store.put(source_key(map_id, "0" * 64), b"orphan")
    source = build(catalog, tmp_path, "b-failed", "failed")
    done = collect_garbage(catalog, map_id="hall", ages=NOW)
    assert set(done.keys["sources"]) == {source_key("hall", "0" * 64), source}
    assert catalog.store.list("maps/hall/versions") == []
    assert len(catalog.store.list("maps/attic/versions")) == 2
    assert catalog.builds.ids() == ["b-failed"]


def test_a_removal_that_was_killed_is_finished(catalog: Catalog, tmp_path: Path):
    build(catalog, tmp_path, "b-failed", "failed")
    catalog.store.delete("builds/b-failed/request.json")
    catalog.store.delete("builds/b-failed/status.json")
    catalog.store.put("builds/b-failed/cancel", b"")
    uploads = Uploads(catalog.store)
    uploads.create("u1", size_bytes=3, file_name="x")
    uploads.append(uploads.get("u1"), b"abc")
    catalog.store.delete("uploads/u1/upload.json")
    collect_garbage(catalog, ages=NOW)
    assert catalog.store.list("builds") == catalog.store.list("uploads") == []


def test_an_upload_that_goes_on_is_young(catalog: Catalog, monkeypatch: pytest.MonkeyPatch):
    uploads = Uploads(catalog.store)
    uploads.create("u1", size_bytes=30, file_name="x")
    let_pass(3.1)  # some stores tell whole seconds
    uploads.append(uploads.get("u1"), b"abc")
    appended = uploads.get("u1").last_modified
    monkeypatch.setattr(catalog.store, "now", lambda: appended)
    assert remove_abandoned(catalog, older_than_s=1.5).count == 0
    assert uploads.get("u1").offset == 3
    assert remove_abandoned(catalog, older_than_s=-5).count == 2


@pytest.mark.slow
@pytest.mark.usefixtures("frequent_snapshots")
def test_entries_that_snapshots_have_summed_up_go(catalog: Catalog, tmp_path: Path):
    for name in ("one", "two"):
        publish(catalog, tmp_path, name)
    for _ in range(6 * EVERY):
        catalog.roll_back("hall")
    state, listed = catalog.state("hall"), catalog.store.list("maps/hall/log")
    assert collect_garbage(catalog, ages=Ages(things_s=-5)).keys["logs"] == [], "a week is not over"
    ages = Ages(things_s=-5, logs_s=-5)
    found = collect_garbage(catalog, ages=ages, dry_run=True).keys["logs"]
    assert catalog.store.list("maps/hall/log") == listed
    assert collect_garbage(catalog, ages=ages).keys["logs"] == found
    assert len(catalog.store.list("maps/hall/log")) <= 2 * EVERY
    assert len(catalog.store.list("maps/hall/snapshots")) == 3
    assert Catalog(catalog.store).state("hall") == state
    assert Catalog(catalog.store).versions("hall") == catalog.versions("hall")


@pytest.mark.usefixtures("frequent_snapshots")
def test_a_long_log_without_snapshots_gets_one(catalog: Catalog, tmp_path: Path):
    for name in ("one", "two"):
        publish(catalog, tmp_path, name)
    for _ in range(2 * EVERY):
        catalog.roll_back("hall")
    for key in catalog.store.list("maps/hall/snapshots"):  # as a release before left it
        catalog.store.delete(key)
    collect_garbage(Catalog(catalog.store))
    (key,) = catalog.store.list("maps/hall/snapshots")
    assert key.endswith(f"{2 * EVERY + 4:06d}.json")
