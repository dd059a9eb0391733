"""Files and manifest of a version in a store, without the map's log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_POINTS, FILE_NAME, Manifest
from firstfix.catalog.versions.objects import VersionFolder, VersionObjects, manifest_first
from firstfix.errors import CorruptVersion
from firstfix.store.store import Store


@pytest.fixture
def made(tmp_path: Path) -> tuple[Path, Manifest]:
    folder = tmp_path / "v"
    folder.mkdir()
    (folder / "a.npy").write_bytes(b"content")
    (folder / "z.npy").write_bytes(b"more of it")
    return folder, Manifest.for_directory(folder)


@pytest.mark.parametrize("generation", [0, 12])
def test_what_was_put_is_read_by_another_process(
    any_store_url: str, made: tuple[Path, Manifest], tmp_path: Path, generation: int
) -> None:
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


def test_the_cloud_for_viewers_is_not_fetched_for_queries(any_store_url: str, tmp_path: Path) -> None:
    folder = tmp_path / "v"
    folder.mkdir()
    for name in ("a.npy", CLOUD_INDEX, CLOUD_POINTS):
        (folder / name).write_bytes(b"content")
    manifest = Manifest.for_directory(folder)
    assert (manifest.query_bytes, manifest.total_bytes) == (7, 21)

    downloaded: list[str] = []

    class Counts(Store):
        def download(self, key: str, *more: Any) -> str:
            downloaded.append(key)
            return super().download(key, *more)

    store = Counts.open(any_store_url)
    at = VersionFolder("hall", manifest.digest, 0)
    VersionObjects(store).put(at, folder, manifest)
    store.put(f"{at.key}/{CLOUD_POINTS}", b"damaged")
    fetched = VersionObjects(store).fetch(at, tmp_path / "cache")
    assert (fetched / "a.npy").read_bytes() == b"content"
    in_place = fetched.parent != tmp_path / "cache"
    assert in_place or [path.name for path in fetched.iterdir()] == ["a.npy"]
    assert [key.rpartition("/")[2] for key in downloaded] == ([] if in_place else ["a.npy"])
    store.delete(f"{at.key}/{CLOUD_POINTS}")
    assert VersionObjects(store).fetch(at, tmp_path / "cache") == fetched


def test_a_removed_version_is_forgotten(made: tuple[Path, Manifest]) -> None:
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


def test_files_that_vanish_while_they_are_put_are_put_again(made: tuple[Path, Manifest]) -> None:
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


def test_the_manifest_goes_first() -> None:
    keys = ["v/a.npy", f"v/{FILE_NAME}", "v/z.npy"]
    assert manifest_first(keys) == [f"v/{FILE_NAME}", "v/a.npy", "v/z.npy"]
