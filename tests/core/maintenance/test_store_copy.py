"""Copies of stores: copied objects, omitted ones, and refusals."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.geopose import Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.sources import put_source
from firstfix.maintenance.backup import copy_store
from firstfix.maintenance.checked_objects import CheckedObjects
from firstfix.maintenance.garbage import Ages, collect_garbage
from firstfix.store.store import Store
from tests.core.fixtures import make_version, recording
from tests.frequent_snapshots import EVERY


@pytest.fixture
def target(source: Catalog, tmp_path: Path) -> Catalog:
    """A copy of the source."""
    copy_store(source.store, (target := Store.open(str(tmp_path / "target"))))
    return Catalog(target)


MADE_ANEW = ("stages/1/a", "uploads/1/a", "idempotency/a", "recorded-queries/a.body", "changes/00000001.json")


def publish(catalog: Catalog, map_id: str, content: bytes, scratch: Path) -> str:
    folder = scratch / content.decode()
    return catalog.publish(map_id, folder, make_version(folder, content * 1000, {"same.npy": content * 1000}))


@pytest.fixture
def source(tmp_path: Path) -> Catalog:
    """Two maps, one of them with two versions and a retired one; a build, a key, and objects not to copy."""
    catalog = Catalog(Store.open(str(tmp_path / "source")))
    for content in (b"1", b"2", b"3"):
        publish(catalog, "hall", content, tmp_path)
    publish(catalog, "attic", b"4", tmp_path)
    catalog.roll_back("hall")
    catalog.retire("hall", catalog.versions("hall")[0].version)
    (tmp_path / "hall.laz").write_bytes(b"cloud")
    put_source(catalog.store, "hall", tmp_path / "hall.laz")
    catalog.builds.put("b1", {"map_id": "hall"})
    catalog.builds.set_status("b1", new_status("queued", map_id="hall"))
    Georeferences(catalog.store).set("hall", Georeference(48.0, 11.0, 500.0, (0.0, 0.0, 0.0, 1.0)))
    ApiKeys(catalog.store).create("robot-7", Grant.parse(["localize"], ["*"]))
    for key in MADE_ANEW:
        catalog.store.put(key, b"{}")
    return catalog


def test_a_copy_has_all_that_lasts(source: Catalog, any_store_url: str, tmp_path: Path):
    target = Catalog(Store.open(any_store_url))
    report = copy_store(source.store, target.store)
    assert report.damaged == []
    assert target.map_ids() == ["attic", "hall"]
    for map_id in target.map_ids():
        assert target.log(map_id) == source.log(map_id)
        assert target.versions(map_id) == source.versions(map_id)
        for found in target.versions(map_id):
            folder = target.fetch_version(map_id, found.version, tmp_path / "fetched")
            target.manifest(map_id, found.version).verify_directory(folder)
    assert target.builds.status("b1") == source.builds.status("b1")
    assert Georeferences(target.store).get("hall") == Georeferences(source.store).get("hall")
    assert [key.name for key in ApiKeys(target.store).all()[0]] == ["robot-7"]
    (kept,) = target.store.list("maps/hall/sources")
    assert target.store.get(kept) == b"cloud"
    assert not {"stages", "uploads", "idempotency", "recorded-queries"} & set(target.store.folders())
    copied = [o for o in target.store.scan() if not o.key.startswith(("changes/", "checked/"))]
    assert report.objects == len(copied)
    assert report.bytes == sum(o.size_bytes for o in copied)


def test_a_copy_is_brought_up_to_date(source: Catalog, target: Catalog, tmp_path: Path):
    assert copy_store(source.store, target.store).objects == 0
    noticed = target.changes.end()
    newest = publish(source, "hall", b"5", tmp_path)
    failed = new_status("failed", map_id="hall")  # as long as "queued"
    source.builds.set_status("b1", failed)
    ApiKeys(source.store).revoke(ApiKeys(source.store).all()[0][0].key_id)
    # two files, manifest, two entries of the log, status, revocation
    assert copy_store(source.store, target.store).objects == 7
    assert target.active_version("hall") == newest
    assert target.changes.since(noticed)[0] == ["hall"], "services on the copy are told"
    assert target.builds.status("b1") == failed
    assert ApiKeys(target.store).all()[0][0].revoked


def test_a_killed_copy_is_resumed(source: Catalog, tmp_path: Path):
    class Dies(Store):
        left = 0

        def put_new(self, key: str, data: bytes | Path) -> bool:
            self.left -= 1
            if not self.left:
                raise KeyboardInterrupt
            return super().put_new(key, data)

    whole = Catalog(Store.open("memory://"))
    copy_store(source.store, whole.store)
    for puts in range(1, 9):
        store = Dies.open(str(tmp_path / f"target-{puts}"))
        assert isinstance(store, Dies)
        store.left = puts
        with pytest.raises(KeyboardInterrupt):
            copy_store(source.store, store)
        for map_id in (begun := Catalog(store)).map_ids():
            for version in begun.state(map_id).published:
                begun.fetch_version(map_id, version, tmp_path / "fetched")
        copy_store(source.store, store)
        assert {map_id: begun.log(map_id) for map_id in begun.map_ids()} == {
            map_id: whole.log(map_id) for map_id in whole.map_ids()
        }


def test_damage_is_named_and_not_copied(source: Catalog, tmp_path: Path):
    version = source.active_version("hall")
    (kept,) = source.store.list("maps/hall/sources")
    damaged = f"maps/hall/versions/{version}/a.npy"
    source.store.put(damaged, b"x" * 1000)
    source.store.put(kept, b"clout")
    other = f"maps/attic/versions/{source.active_version('attic')}/manifest.json"
    source.store.put(other, source.store.get(other) + b" ")
    target = Catalog(Store.open(str(tmp_path / "target")))
    assert sorted(copy_store(source.store, target.store).damaged) == sorted([damaged, kept, other])
    held = target.store.list("maps")
    assert not {damaged, kept, other} & set(held)
    assert f"maps/hall/versions/{version}/manifest.json" not in held, "it would seem whole"
    assert target.log("hall") == source.log("hall")
    source.store.delete(damaged)
    assert damaged in copy_store(source.store, target.store).damaged


def test_two_histories_of_a_map_are_not_mixed(source: Catalog, tmp_path: Path):
    target = Catalog(Store.open(str(tmp_path / "target")))
    publish(target, "hall", b"9", tmp_path)
    source.builds.put("b2", {"map_id": "attic"})
    before = target.store.list("maps/hall")
    report = copy_store(source.store, target.store)
    assert report.conflicts == ["maps/hall/log/000001.json", "maps/hall/log/000002.json"]
    assert report.damaged == []
    assert target.store.list("maps/hall") == before
    assert target.log("attic") == source.log("attic")
    assert target.builds.ids() == ["b2"], "a build of the map that is left out has no sources there"
    assert target.store.list("keys") == source.store.list("keys")


def flipped(data: bytes, word: bytes) -> bytes:
    """The data with one wrong bit in the last character of a word."""
    at = data.index(word) + len(word) - 1
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


FLIPPED = {
    "maps/hall/log/000002.json": b"activated",
    "builds/b1/request.json": b"hall",
    "maps/hall/georeference/000001.json": b"48.0",
    "maps/attic/log/000001.json": b"checksum",
}


@pytest.mark.parametrize("side", ["source", "target"])
def test_the_copy_with_the_right_checksum_wins(source, target, tmp_path, side):
    store = (source if side == "source" else target).store
    right = {key: store.get(key) for key in FLIPPED}
    for key, word in FLIPPED.items():
        store.put(key, flipped(right[key], word))
    report = copy_store(source.store, target.store)
    assert report.conflicts == []
    assert {key: target.store.get(key) for key in FLIPPED} == right
    if side == "source":
        assert sorted(report.damaged) == sorted(FLIPPED)
        assert copy_store(target.store, source.store).conflicts == []
        assert {key: source.store.get(key) for key in FLIPPED} == right, "brought back"
    else:
        assert sorted(report.mended) == sorted(FLIPPED)


def test_a_version_of_another_format_is_copied(tmp_path: Path):
    source, target = (Catalog(Store.open(str(tmp_path / name))) for name in ("source", "target"))
    version = source.publish("hall", tmp_path / "old", make_version(tmp_path / "old", format=1))
    assert copy_store(source.store, target.store).damaged == []
    assert target.store.list(f"maps/hall/versions/{version}") == source.store.list(
        f"maps/hall/versions/{version}"
    )


def test_damage_of_the_same_size_in_the_copy_is_mended(source: Catalog, target: Catalog, tmp_path: Path):
    version = source.active_version("hall")
    (kept,) = source.store.list("maps/hall/sources")
    keys = [f"maps/hall/versions/{version}/{name}" for name in ("a.npy", "manifest.json")]
    keys += [kept, "builds/b1/request.json", "maps/hall/log/000001.json"]
    for key in keys:
        target.store.put(key, b"x" * target.store.size(key))
    report = copy_store(source.store, target.store)
    assert sorted(report.mended) == sorted(keys)
    assert {key: target.store.get(key) for key in keys} == {key: source.store.get(key) for key in keys}


def test_a_copy_reads_again_only_what_was_not_checked(source: Catalog, tmp_path: Path):
    target, reads = recording(str(tmp_path / "target"), "pieces")
    copy_store(source.store, target)
    assert copy_store(source.store, target).objects == 0
    assert reads == [], "what was copied was checked on the way"
    checked = CheckedObjects(target, "hall")
    checked.save(set())  # as if it were long ago
    copy_store(source.store, target)
    assert reads
    assert all(key.startswith("maps/hall/") for _, key in reads)


def test_a_damaged_record_does_not_replace_a_good_one(source: Catalog, target: Catalog, tmp_path: Path):
    good = target.store.get("builds/b1/status.json")
    source.store.put("builds/b1/status.json", b"")
    assert copy_store(source.store, target.store).damaged == ["builds/b1/status.json"]
    assert target.store.get("builds/b1/status.json") == good


@pytest.mark.usefixtures("frequent_snapshots")
def test_a_log_of_which_old_entries_were_collected_is_copied(source: Catalog, tmp_path: Path):
    for _ in range(4 * EVERY):
        source.roll_back("attic") if len(source.state("attic").activated) > 1 else publish(
            source, "attic", b"5", tmp_path
        )
    collect_garbage(source, ages=Ages(things_s=-60, logs_s=-60))
    assert "maps/attic/log/000001.json" not in source.store.list("maps/attic/log")
    target = Catalog(Store.open("memory://"))
    assert copy_store(source.store, target.store).damaged == []
    assert target.state("attic") == source.state("attic")
    assert copy_store(source.store, target.store).objects == 0
