"""A version's files and its manifest in a store, apart from what the map's log says of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.errors import CorruptVersion
from firstfix.manifest import FILE_NAME, Manifest
from firstfix.store import Store
from firstfix.version_objects import VersionObjects, manifest_first


@pytest.fixture
def made(tmp_path: Path) -> tuple[Path, Manifest]:
    folder = tmp_path / "v"
    folder.mkdir()
    (folder / "a.npy").write_bytes(b"content")
    (folder / "z.npy").write_bytes(b"more of it")
    return folder, Manifest.for_directory(folder)


def test_what_was_put_is_read_by_another_process(
    any_store_url: str, made: tuple[Path, Manifest], tmp_path: Path
) -> None:
    folder, manifest = made
    store = Store.open(any_store_url)
    VersionObjects(store).put("hall", folder, manifest)
    VersionObjects(store).put("hall", folder, manifest)  # a repeat changes nothing
    read = VersionObjects(store)
    assert read.exists("hall", manifest.digest)
    assert read.manifest("hall", manifest.digest) == manifest
    assert read.read_file("hall", manifest.digest, "z.npy", max_bytes=10) == b"more of it"
    assert (read.fetch("hall", manifest.digest, tmp_path / "cache") / "a.npy").read_bytes() == b"content"
    assert {version for version, _ in read.scan("hall")} == {manifest.digest}


def test_a_removed_version_is_forgotten(made: tuple[Path, Manifest]) -> None:
    folder, manifest = made
    objects = VersionObjects(Store.open("memory://"))
    objects.put("hall", folder, manifest)
    assert objects.manifest("hall", manifest.digest) == manifest
    objects.remove("hall", manifest.digest, [item.key for _, item in objects.scan("hall")])
    assert not objects.exists("hall", manifest.digest)
    assert list(objects.scan("hall")) == []
    with pytest.raises(CorruptVersion, match="lost its manifest"):
        objects.manifest("hall", manifest.digest)


def test_the_manifest_goes_first() -> None:
    keys = ["v/a.npy", f"v/{FILE_NAME}", "v/z.npy"]
    assert manifest_first(keys) == [f"v/{FILE_NAME}", "v/a.npy", "v/z.npy"]
