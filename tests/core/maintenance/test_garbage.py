"""Garbage: what is collected, and publications during a collection, in every order."""

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
from tests.core.fixtures import publish
from tests.frequent_snapshots import EVERY
from tests.interleavings import Step, run_every_order, run_interleaved
from tests.waiting import let_pass

NOW = Ages(things_s=-5, builds_s=-5)  # whatever its age


def build(catalog: Catalog, tmp_path: Path, build_id: str, state: str, version: str | None = None) -> str:
    """Records a build and puts its source. Returns the key of the source."""
    path = tmp_path / f"{build_id}.ply"
    path.write_text(build_id)
    key = source_key("hall", put_source(catalog.store, "hall", path))
    catalog.builds.put(build_id, {"map_id": "hall", "source": {"key": key}, "trajectory": None, "config": {}})
    catalog.builds.set_status(build_id, new_status(state, map_id="hall", version=version))
    return key


def test_versions_in_use_are_not_collected(any_catalog: Catalog, tmp_path: Path):
    served, retired = publish(any_catalog, tmp_path, "served"), publish(any_catalog, tmp_path, "retired")
    any_catalog.retire("hall", retired, force=True)
    kept = {
        build(any_catalog, tmp_path, "b-served", "succeeded", served),
        build(any_catalog, tmp_path, "b-waits", "queued"),
        build(any_catalog, tmp_path, "b-runs", "running"),
    }
    build(any_catalog, tmp_path, "b-retired", "succeeded", retired)
    build(any_catalog, tmp_path, "b-failed", "failed")
    any_catalog.store.put(source_key("hall", "0" * 64), b"of a service that was killed")
    Uploads(any_catalog.store).create("u1", size_bytes=3, file_name="x")
    claim_build(any_catalog.store, CallersKey("key:a", "key"), "f", "b-served")
    any_catalog.store.put("probe/abc", b"first")
    before = set(any_catalog.store.list())
    would = collect_garbage(any_catalog, ages=NOW, dry_run=True)
    assert set(any_catalog.store.list()) == before
    done = collect_garbage(any_catalog, ages=NOW)
    assert done == would
    assert before - set(any_catalog.store.list()) == {key for keys in done.keys.values() for key in keys}
    assert set(any_catalog.store.list("maps/hall/sources")) == kept
    assert any_catalog.builds.ids() == ["b-runs", "b-served", "b-waits"]
    assert any_catalog.store.list("uploads") == any_catalog.store.list("idempotency") == []
    assert any_catalog.store.list("probe") == []
    assert any_catalog.manifest("hall", served)
    assert collect_garbage(any_catalog, ages=NOW).count == 0


def test_a_failed_builds_record_outlives_its_day_but_not_its_month(any_catalog: Catalog, tmp_path: Path):
    key = build(any_catalog, tmp_path, "b-failed", "failed")
    waiting = build(any_catalog, tmp_path, "b-waiting", "queued")
    done = collect_garbage(any_catalog, ages=Ages(things_s=-5))
    assert done.keys["sources"] == [key], "nothing was made of it"
    assert done.count == 1
    done = collect_garbage(any_catalog, ages=NOW)
    assert len(done.keys["builds"]) == 2
    assert any_catalog.store.exists(waiting)


def test_one_map_alone_is_collected(any_catalog: Catalog, tmp_path: Path):
    for map_id in ("hall", "attic"):
        version = publish(any_catalog, tmp_path, "gone", map_id)
        any_catalog.retire(map_id, version, force=True)
        any_catalog.store.put(source_key(map_id, "0" * 64), b"orphan")
    source = build(any_catalog, tmp_path, "b-failed", "failed")
    done = collect_garbage(any_catalog, map_id="hall", ages=NOW)
    assert set(done.keys["sources"]) == {source_key("hall", "0" * 64), source}
    assert any_catalog.store.list("maps/hall/versions") == []
    assert len(any_catalog.store.list("maps/attic/versions")) == 2
    assert any_catalog.builds.ids() == ["b-failed"]


def test_a_killed_removal_is_finished(any_catalog: Catalog, tmp_path: Path):
    build(any_catalog, tmp_path, "b-failed", "failed")
    any_catalog.store.delete("builds/b-failed/request.json")
    any_catalog.store.delete("builds/b-failed/status.json")
    any_catalog.store.put("builds/b-failed/cancel", b"")
    uploads = Uploads(any_catalog.store)
    uploads.create("u1", size_bytes=3, file_name="x")
    uploads.append(uploads.get("u1"), b"abc")
    any_catalog.store.delete("uploads/u1/upload.json")
    collect_garbage(any_catalog, ages=NOW)
    assert any_catalog.store.list("builds") == any_catalog.store.list("uploads") == []


def test_an_upload_that_goes_on_is_young(any_catalog: Catalog, monkeypatch: pytest.MonkeyPatch):
    uploads = Uploads(any_catalog.store)
    uploads.create("u1", size_bytes=30, file_name="x")
    let_pass(3.1)  # some stores tell whole seconds
    uploads.append(uploads.get("u1"), b"abc")
    appended = uploads.get("u1").last_modified
    monkeypatch.setattr(any_catalog.store, "now", lambda: appended)
    assert remove_abandoned(any_catalog, older_than_s=1.5).count == 0
    assert uploads.get("u1").offset == 3
    assert remove_abandoned(any_catalog, older_than_s=-5).count == 2


@pytest.mark.slow
@pytest.mark.usefixtures("frequent_snapshots")
def test_log_entries_that_snapshots_have_summed_up_are_collected(any_catalog: Catalog, tmp_path: Path):
    for name in ("one", "two"):
        publish(any_catalog, tmp_path, name)
    for _ in range(6 * EVERY):
        any_catalog.roll_back("hall")
    state, listed = any_catalog.state("hall"), any_catalog.store.list("maps/hall/log")
    assert collect_garbage(any_catalog, ages=Ages(things_s=-5)).keys["logs"] == [], "a week is not over"
    ages = Ages(things_s=-5, logs_s=-5)
    found = collect_garbage(any_catalog, ages=ages, dry_run=True).keys["logs"]
    assert any_catalog.store.list("maps/hall/log") == listed
    assert collect_garbage(any_catalog, ages=ages).keys["logs"] == found
    assert len(any_catalog.store.list("maps/hall/log")) <= 2 * EVERY
    assert len(any_catalog.store.list("maps/hall/snapshots")) == 3
    assert Catalog(any_catalog.store).state("hall") == state
    assert Catalog(any_catalog.store).versions("hall") == any_catalog.versions("hall")


@pytest.mark.usefixtures("frequent_snapshots")
def test_a_long_log_without_snapshots_gets_one(any_catalog: Catalog, tmp_path: Path):
    for name in ("one", "two"):
        publish(any_catalog, tmp_path, name)
    for _ in range(2 * EVERY):
        any_catalog.roll_back("hall")
    for key in any_catalog.store.list("maps/hall/snapshots"):  # as a release before left it
        any_catalog.store.delete(key)
    collect_garbage(Catalog(any_catalog.store))
    (key,) = any_catalog.store.list("maps/hall/snapshots")
    assert key.endswith(f"{2 * EVERY + 4:06d}.json")


FILES = {"a.npy": b"content", "z.npy": b"more of it"}


def retired(store: Store, made: tuple[Path, Manifest]) -> None:
    """A version that was published and taken out of service."""
    catalog = Catalog(store)
    catalog.retire("hall", catalog.publish("hall", *made), force=True)


def never_ended(store: Store, made: tuple[Path, Manifest]) -> None:
    """Files of a publication that was killed before its log entry."""
    folder, manifest = made
    at = f"maps/hall/versions/{manifest.digest}"
    for name in FILES:
        store.put_file(f"{at}/{name}", folder / name)
    store.put_new(f"{at}/manifest.json", manifest.to_json())


def one_file(store: Store, made: tuple[Path, Manifest]) -> None:
    """First file of a publication that was killed then."""
    store.put_file(f"maps/hall/versions/{made[1].digest}/a.npy", made[0] / "a.npy")


LEFT = [retired, never_ended, one_file]


def collect(store: Store) -> None:
    Catalog(store).collect_garbage("hall", older_than_s=-5)  # whatever its age


def check_whole(store: Store, made: tuple[Path, Manifest], cache: Path) -> None:
    """Checks that the version is served, also after another collection and another publish."""
    version = made[1].digest
    for _ in range(2):
        catalog = Catalog(store)
        assert catalog.active_version("hall") == version
        for name, content in FILES.items():
            assert catalog.read_file("hall", version, name, max_bytes=100) == content
        collect(store)
    assert Catalog(store).publish("hall", *made) == version
    Catalog(store).fetch_version("hall", version, cache)


@pytest.mark.slow
@pytest.mark.parametrize("left", LEFT)
def test_a_version_published_during_a_collection_is_whole(left, made, tmp_path, monkeypatch):
    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        left(store, made)
        works = [lambda: Catalog(store).publish("hall", *made), lambda: collect(store)]
        steps = run_interleaved(works, switches, monkeypatch=monkeypatch)
        check_whole(store, made, tmp_path / "cache")
        return steps

    run_every_order(run)


@pytest.mark.slow
@pytest.mark.parametrize("left", LEFT)
@pytest.mark.parametrize("killed", ["publish", "collect"])
def test_a_kill_at_any_point_is_mended_by_a_repeat(left, killed, made, tmp_path, monkeypatch):
    def run(kill_at: int, switches: tuple[int, ...]) -> int:
        store = Store.open("memory://")
        left(store, made)
        works = [lambda: Catalog(store).publish("hall", *made), lambda: collect(store)]
        if killed == "collect":
            works.reverse()
        steps = run_interleaved(works, switches, kill_at=kill_at, monkeypatch=monkeypatch)
        if killed == "publish":
            assert Catalog(store).publish("hall", *made) == made[1].digest
        check_whole(store, made, tmp_path / "cache")
        collect(store)
        folders = {key.split("/")[3] for key in store.list("maps/hall/versions")}
        assert len(folders) == 1, "nothing is left that nobody refers to"
        return sum(step.actor == 0 for step in steps)

    kill_at = 0
    while run(kill_at, ()) > kill_at:  # else it ended before
        for switches in ((kill_at // 2,), (kill_at // 2, kill_at)):
            run(kill_at, switches)
        kill_at += 1
