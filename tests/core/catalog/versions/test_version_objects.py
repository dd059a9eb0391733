"""Objects of a version in a store, and the record of the one that answered last."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import CLOUD_POINTS, FILE_NAME, VIEWER_FILES, Manifest
from firstfix.catalog.versions import cache as version_cache
from firstfix.catalog.versions.cache import cached_version
from firstfix.catalog.versions.last_served import LastServed
from firstfix.catalog.versions.objects import VersionFolder, VersionObjects, manifest_first
from firstfix.errors import CorruptVersion, InvalidOption, StoreUnavailable
from firstfix.store.store import Store
from tests.core.fixtures import make_version, recording

CONTENT = b"content of a version"
Fetched = tuple[Catalog, Manifest, Path]


@pytest.fixture
def fetched(catalog: Catalog, tmp_path: Path) -> Fetched:
    """A version in a remote store, and the cache that has fetched it."""
    manifest = make_version(tmp_path / "made", CONTENT)
    catalog.fetch_version("hall", catalog.publish("hall", tmp_path / "made", manifest), tmp_path / "cache")
    return catalog, manifest, tmp_path / "cache"


def next_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(version_cache, "_boot_id", lambda: "of the next start")


def test_a_record_is_of_one_map_of_one_store(tmp_path: Path, fetched: Fetched):
    _, manifest, _ = fetched
    last = LastServed(tmp_path / "last", "s3://secret@maps", "hall")
    assert last.read() is None
    for _ in range(2):
        last.write(manifest)
        assert LastServed(tmp_path / "last", "s3://secret@maps", "hall").read() == manifest
    assert LastServed(tmp_path / "last", "s3://others", "hall").read() is None
    assert LastServed(tmp_path / "last", "s3://secret@maps", "yard").read() is None
    assert [path.name for path in (tmp_path / "last").rglob("*.*")] == ["hall.json"]
    assert "secret" not in str(list((tmp_path / "last").rglob("*")))
    last.forget()
    last.forget()
    assert last.read() is None
    with pytest.raises(InvalidOption):
        LastServed(tmp_path, "s3://maps", "../hall")


def test_an_unreadable_record_is_ignored(tmp_path: Path, fetched: Fetched):
    last = LastServed(tmp_path / "last", "s3://maps", "hall")
    last.write(fetched[1])
    (path,) = (tmp_path / "last").rglob("hall.json")
    good = path.read_bytes()
    for damaged in (b"", b"{}", good[:-1], b"x" + good, good.replace(b":", b": ")):
        path.write_bytes(damaged)
        assert last.read() is None
    path.write_bytes(good)
    assert last.read() == fetched[1]


def test_the_cache_needs_no_store(fetched: Fetched, monkeypatch: pytest.MonkeyPatch):
    _, manifest, cache = fetched
    for _ in range(2):
        folder = cached_version(manifest, cache)
        assert folder is not None
        assert (folder / "a.npy").read_bytes() == CONTENT
        next_start(monkeypatch)  # then it is read again
    (folder / "a.npy").write_bytes(CONTENT.upper())
    assert cached_version(manifest, cache) is None
    (folder / "a.npy").unlink()
    assert cached_version(manifest, cache) is None
    assert cached_version(manifest, cache / "elsewhere") is None


def test_a_restart_of_the_machine_fetches_nothing_again(fetched: Fetched, monkeypatch: pytest.MonkeyPatch):
    catalog, manifest, cache = fetched

    def download(*_: object) -> str:
        raise StoreUnavailable("no network")

    monkeypatch.setattr(catalog.store, "download", download)
    next_start(monkeypatch)
    folder = catalog.fetch_version("hall", manifest.digest, cache)
    assert (folder / "a.npy").read_bytes() == CONTENT
    (folder / "a.npy").write_bytes(CONTENT.upper())
    with pytest.raises(StoreUnavailable):
        catalog.fetch_version("hall", manifest.digest, cache)


@pytest.mark.parametrize("generation", [0, 12])
def test_a_version_is_read_by_another_process(any_store_url, made, tmp_path, generation: int):
    folder, manifest = made
    store = Store.open(any_store_url)
    at = VersionFolder("hall", manifest.digest, generation)
    VersionObjects(store).put(at, folder, manifest)
    VersionObjects(store).put(at, folder, manifest)  # a repeat changes nothing
    read = VersionObjects(store)
    assert read.exists(at)
    assert read.manifest(at) == manifest
    assert read.read_file(at, "z.npy", max_bytes=10) == b"more of it"
    assert (read.fetch(at, tmp_path / "cache") / "a.npy").read_bytes() == b"content"
    assert list(read.scan("hall")) == [at]


def test_the_cloud_for_viewers_is_not_fetched_for_queries(any_store_url: str, tmp_path: Path):
    folder = tmp_path / "v"
    manifest = make_version(folder, files=dict.fromkeys(VIEWER_FILES, b"content"))
    assert (manifest.query_bytes, manifest.total_bytes) == (7, 28)
    store, downloads = recording(any_store_url, "download")
    at = VersionFolder("hall", manifest.digest, 0)
    VersionObjects(store).put(at, folder, manifest)
    store.put(f"{at.key}/{CLOUD_POINTS}", b"damaged")
    fetched = VersionObjects(store).fetch(at, tmp_path / "cache")
    assert (fetched / "a.npy").read_bytes() == b"content"
    in_place = fetched.parent != tmp_path / "cache"
    assert in_place or [path.name for path in fetched.iterdir()] == ["a.npy"]
    assert [key.rpartition("/")[2] for _, key in downloads] == ([] if in_place else ["a.npy"])
    store.delete(f"{at.key}/{CLOUD_POINTS}")
    assert VersionObjects(store).fetch(at, tmp_path / "cache") == fetched


def test_a_removed_version_is_forgotten(made: tuple[Path, Manifest]):
    folder, manifest = made
    objects = VersionObjects(Store.open("memory://"))
    at = VersionFolder("hall", manifest.digest, 0)
    objects.put(at, folder, manifest)
    assert objects.manifest(at) == manifest
    objects.remove(at, [item.key for item in objects.scan("hall")[at]])
    assert not objects.exists(at)
    assert objects.scan("hall") == {}
    with pytest.raises(CorruptVersion, match="lost its manifest"):
        objects.manifest(at)


def test_files_that_vanish_while_they_are_put_are_put_again(made: tuple[Path, Manifest]):
    folder, manifest = made
    at = VersionFolder("hall", manifest.digest, 0)

    class Losing(Store):
        lost = 0

        def put_new(self, key: str, data: bytes | Path) -> bool:
            if self.lost < 2:
                self.lost += 1
                self.delete(f"{at.key}/a.npy")
            return super().put_new(key, data)

    store = Losing.open("memory://")
    VersionObjects(store).put(at, folder, manifest)
    assert store.get(f"{at.key}/a.npy") == b"content"


def test_the_manifest_goes_first():
    keys = ["v/a.npy", f"v/{FILE_NAME}", "v/z.npy"]
    assert manifest_first(keys) == [f"v/{FILE_NAME}", "v/a.npy", "v/z.npy"]
