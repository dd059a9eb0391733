"""Rebuilds of maps from their sources."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source, source_key
from firstfix.errors import NotFound
from firstfix.maintenance.rebuild import rebuild
from firstfix.store.store import Store


@pytest.fixture
def catalog() -> Catalog:
    return Catalog(Store.open("memory://"))


def built(catalog: Catalog, tmp_path: Path, content: bytes, **manifest: int) -> str:
    """Publishes a version of a recorded build with a source. Returns the build's id."""
    cloud = tmp_path / content.decode()
    cloud.write_bytes(content)
    build_id = f"b{content.decode()}"
    key = source_key("hall", put_source(catalog.store, "hall", cloud))
    request = {"map_id": "hall", "source": {"key": key}, "file_name": "hall.laz", "trajectory": None}
    catalog.builds.put(build_id, {**request, "config": {"sensor": content.decode()}, "traceparent": "00-1"})
    folder = tmp_path / f"{content.decode()}-version"
    folder.mkdir()
    (folder / "a.npy").write_bytes(content)
    catalog.publish("hall", folder, Manifest.for_directory(folder, **manifest), build_id=build_id)
    return build_id


def test_the_active_versions_build_is_asked_for_again(catalog: Catalog, tmp_path: Path) -> None:
    first = built(catalog, tmp_path, b"1", format=1)
    built(catalog, tmp_path, b"2")
    version = catalog.versions("hall")[-1].version
    catalog.retire("hall", catalog.versions("hall")[0].version, force=True)
    assert catalog.active_version("hall") == version
    build_id = rebuild(catalog, "hall")
    request = catalog.builds.request(first)
    del request["traceparent"]
    assert catalog.builds.request(build_id) == request
    assert catalog.builds.status(build_id)["state"] == "queued"
    assert catalog.builds.ids()[0] == build_id, "its time sorts before b1"


def test_a_source_that_is_gone_is_said_to_be(catalog: Catalog, tmp_path: Path) -> None:
    build_id = built(catalog, tmp_path, b"1")
    catalog.store.delete(catalog.builds.request(build_id)["source"]["key"])
    with pytest.raises(NotFound, match="source of map hall is gone"):
        rebuild(catalog, "hall")
    assert catalog.builds.ids() == [build_id]


def test_what_was_built_without_a_record_has_to_be_handed_in(catalog: Catalog, tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(b"1")
    catalog.publish("hall", tmp_path, Manifest.for_directory(tmp_path))
    with pytest.raises(NotFound, match="without a record"):
        rebuild(catalog, "hall")
    with pytest.raises(NotFound, match="no active version"):
        rebuild(catalog, "attic")
