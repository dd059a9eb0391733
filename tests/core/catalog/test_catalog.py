"""Publishing, activating, retiring and fetching versions, with kills, races and damage."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_state import Event
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source
from firstfix.catalog.versions import cache as version_cache
from firstfix.errors import (
    Conflict,
    CorruptVersion,
    IncompatibleVersion,
    InvalidOption,
    NotFound,
    OutOfSpace,
    StoreUnavailable,
    TooLarge,
)
from firstfix.store.store import Store
from firstfix.store.writer import RECORDS_BYTES
from tests.core import fixtures


class Killed(BaseException):
    """Exception that, like a kill, no code catches."""


class DiesAfter(Store):
    """Store that kills its user after some puts: right before the next one, or just after it."""

    left = 10**9
    put_first = False

    def _count(self, put: Callable[[], object]) -> None:
        if self.left <= 0:
            if self.put_first:
                put()
            raise Killed
        self.left -= 1

    def put_new(self, key: str, data: bytes | Path) -> bool:
        self._count(lambda: Store.put_new(self, key, data))
        return super().put_new(key, data)

    def put_file(self, key: str, path: Path) -> bool:
        self._count(lambda: Store.put_file(self, key, path))
        return super().put_file(key, path)


def make_version(folder: Path, content: bytes = b"content", **values: object) -> Manifest:
    return fixtures.make_version(folder, content, {"b.npy": content * 1000, "sub/c.json": b"{}"}, **values)


def publish(catalog: Catalog, scratch: Path, content: str = "content", **how: Any) -> str:
    folder = scratch / content
    return catalog.publish("hall", folder, make_version(folder, content.encode()), **how)


def test_a_part_of_a_known_version_costs_one_request(tmp_path: Path):
    url = str(tmp_path / "store")
    version = publish(Catalog(Store.open(url)), tmp_path, "0123456789")
    store, asked = fixtures.recording(url, "get_range", "size", "get", "scan", "list")
    reader = Catalog(store)
    assert reader.read_part("hall", version, "a.npy", 2, 3) == b"234"
    del asked[:]
    assert reader.read_part("hall", version, "a.npy", 5, 5) == b"56789"
    assert [name for name, _ in asked] == ["get_range"]
    for start, length in ((5, 6), (10, 1), (-1, 2)):
        with pytest.raises(InvalidOption):
            reader.read_part("hall", version, "a.npy", start, length)
    with pytest.raises(NotFound, match=r"no c\.npy"):
        reader.read_part("hall", version, "c.npy", 0, 1)


def test_a_part_of_a_retired_version_is_not_found_when_its_files_are_gone(any_catalog, tmp_path):
    manifest = make_version(tmp_path / "v", b"0123456789")
    version = any_catalog.publish("hall", tmp_path / "v", manifest)
    reader = Catalog(any_catalog.store)
    assert reader.read_part("hall", version, "a.npy", 0, 3) == b"012"
    any_catalog.remove_map("hall")
    assert all(
        "a.npy" not in item.key or any_catalog.store.delete(item.key) is None
        for item in any_catalog.store.scan("maps")
    )
    with pytest.raises(NotFound, match="has no version"):
        reader.read_part("hall", version, "a.npy", 0, 3)
    again = any_catalog.publish("hall", tmp_path / "v", manifest)
    assert again == version
    assert reader.read_part("hall", version, "a.npy", 0, 3) == b"012"


def test_a_published_version_is_listed_active_and_fetched(any_catalog: Catalog, tmp_path: Path):
    manifest = make_version(tmp_path / "v", config={"x": 1})
    version = any_catalog.publish("hall", tmp_path / "v", manifest)
    assert version == manifest.digest
    assert any_catalog.map_ids() == ["hall"]
    assert any_catalog.active_version("hall") == version
    assert any_catalog.manifest("hall", version) == manifest
    (info,) = any_catalog.versions("hall")
    assert (info.version, info.active) == (version, True)
    folder = any_catalog.fetch_version("hall", version, tmp_path / "cache")
    manifest.verify_directory(folder)
    assert any_catalog.fetch_version("hall", version, tmp_path / "cache") == folder


@pytest.mark.parametrize("put_first", [False, True])
def test_a_publish_killed_at_any_put_is_never_half_visible_and_can_be_resumed(put_first: bool, tmp_path):
    old = make_version(tmp_path / "old", b"old")
    new = make_version(tmp_path / "new", b"new")
    puts = len(new.files) + 3  # manifest, published, activated
    notice = 1
    for k in range(puts + notice + 1):
        store = DiesAfter.open("memory://")
        assert isinstance(store, DiesAfter)
        Catalog(store).publish("hall", tmp_path / "old", old)
        store.left, store.put_first = k, put_first
        if k < puts + notice:
            with pytest.raises(Killed):
                Catalog(store).publish("hall", tmp_path / "new", new)
        else:
            Catalog(store).publish("hall", tmp_path / "new", new)
        store.left = 10**9
        reader = Catalog(store)
        for info in reader.versions("hall"):  # whatever is seen is whole
            reader.fetch_version("hall", info.version, tmp_path / f"cache-{k}-{info.version[:8]}")
        done = k + put_first
        assert reader.active_version("hall") == (new.digest if done >= puts else old.digest)
        assert len(reader.versions("hall")) == (2 if done >= puts - 1 else 1)
        if done < puts - 1:
            with pytest.raises(NotFound):
                reader.manifest("hall", new.digest)

        assert reader.publish("hall", tmp_path / "new", new) == new.digest
        assert reader.active_version("hall") == new.digest
        assert [e.event for e in reader.log("hall")] == [Event.PUBLISHED, Event.ACTIVATED] * 2


def test_a_directory_unlike_its_manifest_is_not_published(catalog: Catalog, tmp_path: Path):
    manifest = make_version(tmp_path)
    (tmp_path / "b.npy").write_bytes(b"other")
    with pytest.raises(CorruptVersion, match=r"b\.npy"):
        catalog.publish("hall", tmp_path, manifest)
    assert catalog.store.list() == []


def test_versions_are_activated_rolled_back_and_retired(any_catalog: Catalog, tmp_path: Path):
    catalog = any_catalog
    one, two = (publish(catalog, tmp_path, name) for name in ("one", "two"))
    assert [info.version for info in catalog.versions("hall")] == [two, one]
    assert catalog.roll_back("hall") == one == catalog.active_version("hall")
    assert catalog.roll_back("hall") == two, "twice comes back"
    for _ in range(2):
        catalog.activate("hall", one)
        assert catalog.active_version("hall") == one
    assert len(catalog.log("hall")) == 7
    with pytest.raises(Conflict):
        catalog.retire("hall", one)
    catalog.retire("hall", two)
    assert [info.version for info in catalog.versions("hall")] == [one]
    with pytest.raises(Conflict, match="active before"):
        catalog.roll_back("hall")
    with pytest.raises(NotFound):
        catalog.roll_back("attic")
    for call in (catalog.activate, catalog.retire, catalog.manifest):
        with pytest.raises(NotFound):
            call("hall", two)
    catalog.retire("hall", one, force=True)
    assert catalog.active_version("hall") is None
    assert catalog.versions("hall") == catalog.map_ids() == []
    publish(catalog, tmp_path, "two")
    assert catalog.active_version("hall") == two


def test_a_repeated_build_does_not_undo_what_was_done_since(catalog: Catalog, tmp_path: Path):
    one = publish(catalog, tmp_path, "1", build_id="b1")
    manifest = make_version(tmp_path / "2", b"2")
    two = catalog.publish("hall", tmp_path / "2", manifest, build_id="b2")
    catalog.activate("hall", one)
    catalog.publish("hall", tmp_path / "2", manifest, build_id="b2")
    assert catalog.active_version("hall") == one
    catalog.retire("hall", two)
    catalog.publish("hall", tmp_path / "2", manifest, build_id="b2")
    assert [info.version for info in catalog.versions("hall")] == [one]
    catalog.publish("hall", tmp_path / "2", manifest, build_id="b3")  # a new wish
    assert catalog.active_version("hall") == two


def test_a_version_without_its_manifest_is_not_listed(any_catalog: Catalog, tmp_path: Path):
    version = publish(any_catalog, tmp_path)
    any_catalog.store.delete(f"maps/hall/versions/{version}/manifest.json")
    reader = Catalog(any_catalog.store)
    assert reader.versions("hall") == []
    with pytest.raises(CorruptVersion, match="manifest"):
        reader.fetch_version("hall", version, tmp_path / "cache")


@pytest.mark.parametrize("name", ["a.npy", "b.npy", "sub/c.json"])
@pytest.mark.parametrize("damage", ["flip", "cut", "remove"])
def test_every_damaged_file_is_refused_by_name(name: str, damage: str, any_store_url: str, tmp_path: Path):
    catalog = Catalog(Store.open(any_store_url))
    version = publish(catalog, tmp_path)
    key = f"maps/hall/versions/{version}/{name}"
    data = catalog.store.get(key)
    if damage == "remove":
        catalog.store.delete(key)
    else:
        catalog.store.put(key, data[:-1] if damage == "cut" else bytes([data[0] ^ 1]) + data[1:])
    with pytest.raises(CorruptVersion, match=name.rsplit("/", 1)[-1]):
        catalog.fetch_version("hall", version, tmp_path / "cache")
    assert not (tmp_path / "cache" / version).exists()
    catalog.store.put(key, data)
    make_version(tmp_path / "v").verify_directory(catalog.fetch_version("hall", version, tmp_path / "cache"))


def test_a_restart_of_the_machine_verifies_everything_again(catalog, tmp_path, monkeypatch):
    """A power cut may have destroyed bytes of a fetched file without changing its size and time."""
    version = publish(catalog, tmp_path)
    path = catalog.fetch_version("hall", version, tmp_path / "cache") / "a.npy"
    content, stat = path.read_bytes(), path.stat()
    with path.open("r+b") as file:
        file.write(bytes(len(content)))
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    monkeypatch.setattr(version_cache, "_boot_id", lambda: "of the next start")
    assert (catalog.fetch_version("hall", version, tmp_path / "cache") / "a.npy").read_bytes() == content


def test_damage_after_verification_is_found(any_store_url: str, tmp_path: Path):
    catalog = Catalog(Store.open(any_store_url))
    manifest = make_version(tmp_path / "v")
    version = catalog.publish("hall", tmp_path / "v", manifest)
    folder = catalog.fetch_version("hall", version, tmp_path / "cache")
    original = (folder / "a.npy").read_bytes()
    (folder / "a.npy").write_bytes(original[:-1] + b"X")
    if catalog.store.local_path(f"maps/hall/versions/{version}/a.npy") is not None:
        with pytest.raises(CorruptVersion):  # it is the store's own
            catalog.fetch_version("hall", version, tmp_path / "cache")
    else:
        again = catalog.fetch_version("hall", version, tmp_path / "cache")
        manifest.verify_directory(again)


def test_an_altered_manifest_is_refused(catalog: Catalog, tmp_path: Path):
    version = catalog.publish("hall", tmp_path / "v", make_version(tmp_path / "v", config={"x": 1}))
    key = f"maps/hall/versions/{version}/manifest.json"
    original = catalog.store.get(key)
    for data, error in (
        (original.replace(b'"x":1', b'"x":2'), CorruptVersion),
        (original[:-5], CorruptVersion),
        (original.replace(b'"format":9', b'"format":10'), IncompatibleVersion),
    ):
        catalog.store.put(key, data)
        with pytest.raises(error):
            Catalog(catalog.store).manifest("hall", version)


def test_many_readers_fetch_at_once(s3_url: str, tmp_path: Path):
    store = Store.open(s3_url)
    manifest = make_version(tmp_path / "v")
    version = Catalog(store).publish("hall", tmp_path / "v", manifest)

    def fetch(_: int) -> Path:
        folder = Catalog(store).fetch_version("hall", version, tmp_path / "cache")
        manifest.verify_directory(folder)
        return folder

    assert len(set(fixtures.at_once(8, fetch))) == 1
    names = [path.name for path in (tmp_path / "cache").iterdir()]
    assert [name for name in names if not name.startswith(".")] == [version]


def test_a_killed_download_is_gone_on_with(tmp_path: Path):
    class DiesDownloading(Store):
        left = 1
        asked: list[str]

        def download(self, key: str, path: Path) -> str:
            self.asked.append(key)
            if self.left == 0:
                raise Killed
            self.left -= 1
            return super().download(key, path)

    store = DiesDownloading.open("memory://")
    assert isinstance(store, DiesDownloading)
    store.asked = []
    manifest = make_version(tmp_path / "v")
    version = Catalog(store).publish("hall", tmp_path / "v", manifest)
    with pytest.raises(Killed):
        Catalog(store).fetch_version("hall", version, tmp_path / "cache")
    assert not (tmp_path / "cache" / version).exists()
    store.left, store.asked = 10, []
    manifest.verify_directory(Catalog(store).fetch_version("hall", version, tmp_path / "cache"))
    assert len(store.asked) == len(manifest.files) - 1
    store.asked = []
    Catalog(store).fetch_version("hall", version, tmp_path / "cache")
    assert store.asked == []


def test_a_full_disk_is_out_of_space(tmp_path: Path):
    class Full(Store):
        def download(self, key: str, path: Path) -> str:
            raise OSError(errno.ENOSPC, "No space left on device")

    catalog = Catalog(Full.open("memory://"))
    version = publish(catalog, tmp_path)
    with pytest.raises(OutOfSpace):
        catalog.fetch_version("hall", version, tmp_path / "cache")


def test_a_source_is_kept_once_by_its_content(any_catalog: Catalog, tmp_path: Path):
    (tmp_path / "cloud.ply").write_bytes(b"ply" * 1000)
    sha256 = put_source(any_catalog.store, "hall", tmp_path / "cloud.ply")
    assert put_source(any_catalog.store, "hall", tmp_path / "cloud.ply") == sha256
    assert any_catalog.store.list() == [f"maps/hall/sources/{sha256}"]
    assert any_catalog.map_ids() == []  # a map without a version is none yet


def test_unknown_ids_take_no_memory(catalog: Catalog):
    for k in range(50):
        assert catalog.active_version(f"made-up-{k}") is None
    assert catalog._logs == {}


def test_every_change_leaves_a_notice(any_catalog: Catalog, tmp_path: Path):
    one = publish(any_catalog, tmp_path, "1")
    any_catalog.publish("attic", tmp_path / "1", make_version(tmp_path / "1", b"1"))
    two = publish(any_catalog, tmp_path, "2")
    assert any_catalog.changes.since(0) == (["hall", "attic"], 3)
    any_catalog.activate("hall", one)
    any_catalog.activate("hall", one)
    any_catalog.retire("hall", two)
    assert any_catalog.changes.since(3) == (["hall"], 5)
    three = publish(any_catalog, tmp_path, "3")
    assert any_catalog.roll_back("hall") == one != three
    assert any_catalog.changes.since(6) == (["hall"], 7)


def test_a_notice_that_cannot_be_written_does_not_undo_the_change(catalog, tmp_path, monkeypatch):

    def fails(map_id: str) -> None:
        raise StoreUnavailable("gone")

    monkeypatch.setattr(catalog.changes, "note", fails)
    version = publish(catalog, tmp_path)
    assert catalog.active_version("hall") == version


def test_missing_maps_and_versions_are_not_found(catalog: Catalog, tmp_path: Path):
    version = "0" * 64
    assert catalog.active_version("hall") is None
    for call in (
        lambda: catalog.versions("hall"),
        lambda: catalog.manifest("hall", version),
        lambda: catalog.activate("hall", version),
        lambda: catalog.retire("hall", version),
        lambda: catalog.fetch_version("hall", version, tmp_path),
    ):
        with pytest.raises(NotFound):
            call()


@pytest.mark.parametrize("map_id", ["", "Hall", "-a", "a/b", "../a", "a" * 64, "a\n", "é"])
def test_an_invalid_id_is_refused(catalog: Catalog, map_id: str, tmp_path: Path):
    for call in (
        lambda: catalog.state(map_id),
        lambda: catalog.publish(map_id, tmp_path, Manifest({})),
        lambda: catalog.builds.put(map_id, {}),
        lambda: catalog.collect_garbage(map_id),
    ):
        with pytest.raises(InvalidOption):
            call()
    with pytest.raises(InvalidOption):
        catalog.manifest("hall", "ABC")


def test_a_file_is_verified_when_it_is_read(any_catalog: Catalog, tmp_path: Path):
    manifest = make_version(tmp_path / "v")
    version = any_catalog.publish("hall", tmp_path / "v", manifest)
    name, entry = next(iter(manifest.files.items()))
    assert (
        any_catalog.read_file("hall", version, name, max_bytes=entry.bytes)
        == (tmp_path / "v" / name).read_bytes()
    )
    with pytest.raises(TooLarge):
        any_catalog.read_file("hall", version, name, max_bytes=entry.bytes - 1)
    with pytest.raises(NotFound):
        any_catalog.read_file("hall", version, "manifest.json", max_bytes=100)
    any_catalog.store.put(f"maps/hall/versions/{version}/{name}", b"x")
    with pytest.raises(CorruptVersion, match="altered"):
        any_catalog.read_file("hall", version, name, max_bytes=entry.bytes)
    any_catalog.store.delete(f"maps/hall/versions/{version}/{name}")
    with pytest.raises(CorruptVersion, match="lost"):
        any_catalog.read_file("hall", version, name, max_bytes=entry.bytes)


def test_a_version_larger_than_the_disk_is_not_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The last bytes of a full disk are for records: else nobody could say that it is full."""
    catalog = Catalog(Store.open(f"file://{tmp_path / 'store'}"))
    manifest = make_version(tmp_path / "made")
    left = RECORDS_BYTES + sum(entry.bytes for entry in manifest.files.values())
    free = SimpleNamespace(free=left - 1)
    monkeypatch.setattr("firstfix.store.writer.shutil.disk_usage", lambda path: free)
    with pytest.raises(OutOfSpace, match=rf"needs {left - RECORDS_BYTES} bytes .* {left - 1} bytes are free"):
        catalog.publish("hall", tmp_path / "made", manifest)
    assert catalog.store.list() == []
    free.free = left
    version = catalog.publish("hall", tmp_path / "made", manifest)
    free.free = 0
    assert catalog.publish("hall", tmp_path / "made", manifest) == version, "nothing is missing"
