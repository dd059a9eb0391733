"""The record of the version that answered last, and the cache without a store."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.versions import cache as version_cache
from firstfix.catalog.versions.cache import cached_version
from firstfix.catalog.versions.last_served import LastServed
from firstfix.errors import InvalidOption, StoreUnavailable
from firstfix.store.store import Store

CONTENT = b"content of a version"


@pytest.fixture
def fetched(tmp_path: Path) -> tuple[Catalog, Manifest, Path]:
    """A version in a remote store, and the cache that has fetched it."""
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "a.npy").write_bytes(CONTENT)
    manifest = Manifest.for_directory(tmp_path / "made")
    catalog = Catalog(Store.open("memory://"))
    version = catalog.publish("hall", tmp_path / "made", manifest)
    catalog.fetch_version("hall", version, tmp_path / "cache")
    return catalog, manifest, tmp_path / "cache"


def next_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(version_cache, "_boot_id", lambda: "of the next start")


def test_a_record_is_of_one_map_of_one_store(tmp_path: Path, fetched: tuple[Catalog, Manifest, Path]) -> None:
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


def test_a_record_that_cannot_be_read_is_none(
    tmp_path: Path, fetched: tuple[Catalog, Manifest, Path]
) -> None:
    last = LastServed(tmp_path / "last", "s3://maps", "hall")
    last.write(fetched[1])
    (path,) = (tmp_path / "last").rglob("hall.json")
    good = path.read_bytes()
    for damaged in (b"", b"{}", good[:-1], b"x" + good, good.replace(b":", b": ")):
        path.write_bytes(damaged)
        assert last.read() is None
    path.write_bytes(good)
    assert last.read() == fetched[1]


def test_the_cache_needs_no_store(
    fetched: tuple[Catalog, Manifest, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_after_a_start_of_the_machine_what_is_right_is_not_fetched_again(
    fetched: tuple[Catalog, Manifest, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
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
