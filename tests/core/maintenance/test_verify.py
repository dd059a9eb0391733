"""Verification: damage of every kind is found, and repaired if another object has the right content."""

from __future__ import annotations

import hashlib
from datetime import timedelta
from pathlib import Path

import pytest

from firstfix.builds.records import new_status
from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.geopose import Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from firstfix.catalog.sources import put_source
from firstfix.catalog.uploads import parts
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.maintenance.repair import QUARANTINE, Repair
from firstfix.maintenance.verify import Verification
from firstfix.store.json_record import RecordKind
from firstfix.store.store import Store
from tests.core import fixtures
from tests.frequent_snapshots import EVERY


@pytest.fixture
def recorded(any_store_url: str) -> tuple[Store, list[tuple[str, str]]]:
    """An empty store, and what is read in pieces of it."""
    return fixtures.recording(any_store_url, "pieces")


@pytest.fixture
def catalog(recorded: tuple[Store, list[tuple[str, str]]], tmp_path: Path) -> Catalog:
    """Two versions of a map that have a file in common, a source, a shared stage, and records."""
    store, _ = recorded
    catalog = Catalog(store)
    for content in (b"1", b"2"):
        publish(catalog, "hall", content, tmp_path, build_id=f"b{content.decode()}")
    (tmp_path / "hall.laz").write_bytes(b"cloud")
    put_source(catalog.store, "hall", tmp_path / "hall.laz")
    for build_id in ("b1", "b2", "b3"):
        catalog.builds.put(build_id, {"map_id": "hall"})
        catalog.builds.set_status(build_id, new_status("queued", map_id="hall"))
    georeferences = Georeferences(store)
    for height_m in (1.0, 2.0):
        georeferences.set("hall", Georeference(48.0, 11.0, height_m, (0.0, 0.0, 0.0, 1.0)))
    return catalog


def publish(catalog: Catalog, map_id: str, content: bytes, scratch: Path, *, build_id: str = "") -> str:
    files = {"own.npy": content * 1000, "common.npy": b"common" * 1000}
    folder = scratch / f"{map_id}-{content.decode()}"
    return catalog.publish(map_id, folder, fixtures.make_version(folder, b"", files), build_id=build_id)


def verified(catalog: Catalog, *, repair: bool = False, cache: Path | None = None) -> dict[str, str]:
    """Damaged keys, each with the repair that was made."""
    store = catalog.store
    report = Verification(store, repair=Repair(store, cache) if repair else None).run()
    return {finding.key: finding.mended for finding in report.findings}


def spoil(store: Store, key: str) -> None:
    """Other bytes of the same size."""
    store.put(key, bytes(byte ^ 1 for byte in store.get(key)))


def test_a_sound_store_has_no_findings(catalog: Catalog):
    report = Verification(catalog.store).run()
    assert report.findings == []
    records = len([key for key in catalog.store.list() if key.endswith(".json")])
    assert report.objects == records + 6 + 1, "three files each of two versions, and a source"
    assert verified(catalog, repair=True) == {}


def test_a_file_is_mended_from_another_version(catalog: Catalog, tmp_path: Path):
    version = catalog.active_version("hall")
    folder = f"maps/hall/versions/{version}"
    spoil(catalog.store, f"{folder}/common.npy")
    assert verified(catalog) == {f"{folder}/common.npy": ""}
    assert "copied from maps/hall/versions/" in verified(catalog, repair=True)[f"{folder}/common.npy"]
    catalog.store.delete(f"{folder}/common.npy")
    assert verified(catalog, repair=True)[f"{folder}/common.npy"]
    assert verified(catalog) == {}
    assert version is not None
    Catalog(catalog.store).fetch_version("hall", version, tmp_path / "cache")


def test_a_file_is_mended_from_a_shared_stage_or_this_machines_cache(catalog: Catalog, tmp_path: Path):
    version = catalog.active_version("hall")
    key = f"maps/hall/versions/{version}/own.npy"
    spoil(catalog.store, key)
    assert verified(catalog, repair=True) == {key: ""}, "there is no other copy"
    SharedStages(catalog.store).put("a" * 64, "build_index", tmp_path / "hall-2")
    assert verified(catalog, repair=True)[key].startswith("copied from stages/")
    for stage in catalog.store.list("stages"):
        catalog.store.delete(stage)
    spoil(catalog.store, key)
    cache = tmp_path / "cache"
    cache.mkdir()
    (tmp_path / "hall-2").rename(cache / str(version))
    assert verified(catalog, repair=True, cache=cache)[key].startswith("copied from ")
    assert verified(catalog) == {}


def test_a_damaged_copy_is_not_copied(catalog: Catalog):
    keys = [key for key in catalog.store.list("maps/hall/versions") if key.endswith("/common.npy")]
    for key in keys:
        spoil(catalog.store, key)
    assert verified(catalog, repair=True) == dict.fromkeys(keys, "")


def test_damage_without_another_copy_is_named_and_left(catalog: Catalog):
    (source,) = catalog.store.list("maps/hall/sources")
    version = catalog.active_version("hall")
    manifest = f"maps/hall/versions/{version}/manifest.json"
    last = "maps/hall/georeference/000002.json"
    entry = "maps/hall/log/000002.json"
    for key in (source, manifest, last, entry):
        spoil(catalog.store, key)
    before = {key: catalog.store.get(key) for key in (source, manifest, last, entry)}
    assert verified(catalog, repair=True) == dict.fromkeys(before, "")
    assert {key: catalog.store.get(key) for key in before} == before
    catalog.store.delete(manifest)
    catalog.store.delete(entry)
    assert verified(catalog).keys() == before.keys(), "what is missing is named too"


def test_damaged_records_are_moved_aside_or_written_again(catalog: Catalog):
    store = catalog.store
    uploads = Uploads(store)
    uploads.create("u1", size_bytes=3, file_name="a.ply")
    damaged = {
        "builds/b1/status.json": RecordKind.BUILD_STATUS,
        "builds/b3/request.json": RecordKind.BUILD_REQUEST,
        "changes/00000001.json": RecordKind.CHANGE_NOTICE,
        "uploads/u1/upload.json": RecordKind.UPLOAD,
        "maps/hall/georeference/000001.json": RecordKind.GEOREFERENCE,
    }
    for key in damaged:
        store.put(key, b"")
    assert verified(catalog).keys() == damaged.keys()
    assert all(verified(catalog, repair=True).values())
    fresh = Catalog(store)
    assert fresh.builds.status("b1")["state"] == "succeeded", "the map's log says so"
    assert fresh.builds.ids() == ["b1", "b2"]
    assert fresh.changes.end() == 2
    assert uploads.ids() == []
    assert Georeferences(store).get("hall") is not None
    assert {key for key in damaged if store.exists(f"{QUARANTINE}/{key}")} == damaged.keys()
    assert verified(catalog) == {}


def test_a_build_with_a_damaged_status_is_queued_again(catalog: Catalog):
    catalog.store.put("builds/b3/status.json", b"{")
    assert "queued again" in verified(catalog, repair=True)["builds/b3/status.json"]
    assert catalog.builds.status("b3")["state"] == "queued"


@pytest.mark.usefixtures("frequent_snapshots")
def test_an_entry_of_a_log_is_written_again_from_a_snapshot(catalog: Catalog):
    for _ in range(EVERY):
        catalog.roll_back("hall")
    state = Catalog(catalog.store).state("hall")
    key = f"maps/hall/log/{EVERY - 7:06d}.json"
    good = catalog.store.get(key)
    catalog.store.put(key, b"")
    assert "snapshot" in verified(catalog, repair=True)[key]
    assert catalog.store.get(key) == good
    assert Catalog(catalog.store).state("hall") == state


def test_lately_verified_objects_are_not_read_again(catalog: Catalog, recorded):
    store, reads = recorded
    age = timedelta(days=30)
    Verification(store, max_age=age).run()
    reads.clear()
    report = Verification(store, max_age=age).run()
    assert (reads, report.fresh) == ([], 7)
    (source,) = store.list("maps/hall/sources")
    store.put(source, b"clout")
    report = Verification(store, max_age=age).run()
    assert reads == [("pieces", source)], "it was put again since"
    assert [finding.key for finding in report.findings] == [source]
    reads.clear()
    Verification(store, max_age=age).run()
    assert reads == [("pieces", source)], "what is damaged is never fresh"
    reads.clear()
    Verification(store, max_age=timedelta()).run()
    assert len(reads) == 7


def test_each_step_reads_little(catalog: Catalog, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("firstfix.store.store.CHUNK_BYTES", 1000)
    steps = list(Verification(catalog.store).steps())
    assert max(steps) < 2000
    assert sum(steps) >= 2 * 7000


def test_publishing_again_mends_damage_of_the_same_size(catalog: Catalog, tmp_path: Path):
    version = catalog.active_version("hall")
    keys = [f"maps/hall/versions/{version}/{name}" for name in ("own.npy", "manifest.json")]
    (source,) = catalog.store.list("maps/hall/sources")
    for key in (*keys, source):
        spoil(catalog.store, key)
    folder = tmp_path / "hall-2"
    assert Catalog(catalog.store).publish("hall", folder, Manifest.for_directory(folder)) == version
    put_source(catalog.store, "hall", tmp_path / "hall.laz")
    assert verified(catalog) == {}


def test_an_upload_mends_the_source_that_it_repeats(catalog: Catalog):
    sha256 = hashlib.sha256(b"cloud").hexdigest()
    key = f"maps/hall/sources/{sha256}"
    spoil(catalog.store, key)
    uploads = Uploads(catalog.store)
    uploads.create("u1", size_bytes=5, file_name="hall.laz")
    assert uploads.keep_as_source(uploads.append(uploads.get("u1"), b"cloud"), "hall") == sha256
    assert catalog.store.get(key) == b"cloud"


QUERY_ID = "20260101t000000000000-0000000a"
BODY, RECORD = f"recorded-queries/{QUERY_ID}.body", f"recorded-queries/{QUERY_ID}.json"


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> Store:
    """One recorded query; an upload that is whole, and one under way, in parts of three bytes."""
    monkeypatch.setattr(parts, "PART_BYTES", 3)
    store = Store.open("memory://")
    answer = {"verdict": "rejected", "reasons": [], "probability": 0.1}
    recorded = RecordedQuery(QUERY_ID, "2026-01-01", "http", "r", "", "hall", "x/y", "", {}, answer, 4)
    RecordedQueries(store).put(recorded, b"body")
    uploads = Uploads(store)
    for upload_id, size_bytes in (("whole", 8), ("half", 9)):
        uploads.create(upload_id, size_bytes=size_bytes, file_name="a.ply")
        for data in (b"abc", b"def", b"gh"):
            uploads.append(uploads.get(upload_id), data)
    uploads.finish(uploads.get("whole"))
    return store


def findings(store: Store) -> dict[str, str]:
    return {finding.key: finding.problem for finding in Verification(store).run().findings}


def part(upload_id: str, offset: int) -> str:
    return f"uploads/{upload_id}/parts/{offset:020d}"


def test_sound_bodies_are_read_and_counted(store: Store):
    report = Verification(store).run()
    assert report.findings == []
    assert report.kinds["recorded_body"] == 1
    assert report.kinds["upload_part"] == 6
    assert report.kinds["upload"] == 2
    assert sum(report.kinds.values()) == report.objects


@pytest.mark.parametrize(("data", "why"), [(b"bodx", "sha256"), (b"bod", "3 bytes"), (None, "missing")])
def test_a_damaged_body_of_a_recorded_query_is_found(store: Store, data: bytes | None, why: str):
    store.delete(BODY) if data is None else store.put(BODY, data)
    found = findings(store)
    assert found.keys() == {BODY}
    assert why in found[BODY]


@pytest.mark.parametrize(("upload_id", "size_bytes"), [("whole", 8), ("half", 9)])
def test_missing_and_short_parts_of_an_upload_are_found(store: Store, upload_id: str, size_bytes: int):
    record = f"uploads/{upload_id}/upload.json"
    store.put(part(upload_id, 3), b"de")
    assert findings(store) == {record: f"a part is missing or cut off at byte 5 of {size_bytes}"}
    store.delete(part(upload_id, 3))
    assert findings(store) == {record: f"a part is missing or cut off at byte 3 of {size_bytes}"}


def test_a_missing_last_part_of_an_upload_under_way_is_no_damage(store: Store):
    store.delete(part("half", 6))
    assert findings(store) == {}, "the sender goes on from there"


def test_altered_parts_of_an_upload_are_found(store: Store):
    uploads = Uploads(store)
    uploads.create("told", size_bytes=3, file_name="a.ply", sha256=hashlib.sha256(b"abc").hexdigest())
    uploads.append(uploads.get("told"), b"abc")
    assert findings(store) == {}
    store.put(part("told", 0), b"abd")
    store.put(part("whole", 3), b"dEf")
    assert findings(store) == {
        f"uploads/{one}/upload.json": "the body has another sha256 than its record says"
        for one in ("told", "whole")
    }
