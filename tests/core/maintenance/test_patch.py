"""Requests of patches: by the build of the active version, where the map's config or the caller allows it."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.builds.config import BuildConfig
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source, source_key
from firstfix.errors import Conflict, NotFound
from firstfix.maintenance.patch import request_patch
from firstfix.maintenance.rebuild import rebuild
from firstfix.store.store import Store


@pytest.fixture
def catalog() -> Catalog:
    return Catalog(Store.open("memory://"))


def built(catalog: Catalog, tmp_path: Path, patch: str, *, provisional: bool = False) -> str:
    """Publishes a version of a recorded build, whose config says this of patches."""
    folder = tmp_path / "version"
    folder.mkdir()
    (folder / "a.npy").write_bytes(b"1")
    key = source_key("hall", put_source(catalog.store, "hall", folder / "a.npy"))
    catalog.put_build(
        "b1",
        {"map_id": "hall", "source": {"key": key}, "file_name": "hall.laz", "trajectory": None}
        | {"config": {"patch": patch}, "owner": "key:k1", "traceparent": "00-1"},
    )
    manifest = Manifest.for_directory(folder, provisional=provisional)
    return catalog.publish("hall", folder, manifest, build_id="b1")


def test_a_patch_is_a_build_of_the_same_sources(catalog: Catalog, tmp_path: Path):
    version = built(catalog, tmp_path, "propose")
    request = catalog.build_request(request_patch(catalog, "hall"))
    assert request.pop("patch") == {"base": version, "mode": "propose"}
    before = catalog.build_request("b1")
    assert request == {name: before[name] for name in request}
    assert "owner" not in request


def test_patches_are_off_unless_the_map_or_the_caller_says_otherwise(catalog: Catalog, tmp_path: Path):
    built(catalog, tmp_path, "off")
    with pytest.raises(Conflict, match="patches of map hall are off"):
        request_patch(catalog, "hall")
    assert catalog.build_ids() == ["b1"]
    build_id = request_patch(catalog, "hall", "activate")
    assert catalog.build_request(build_id)["patch"]["mode"] == "activate"
    assert catalog.build_request(build_id)["config"] == {"patch": "off"}, "of this build alone"


def test_a_map_without_a_full_version_is_not_patched(catalog: Catalog, tmp_path: Path):
    with pytest.raises(NotFound):
        request_patch(catalog, "hall", "propose")
    built(catalog, tmp_path, "propose", provisional=True)
    with pytest.raises(Conflict, match="provisional"):
        request_patch(catalog, "hall")


def test_a_rebuild_repeats_no_patch(catalog: Catalog, tmp_path: Path):
    version = built(catalog, tmp_path, "propose")
    build_id = request_patch(catalog, "hall")
    folder = tmp_path / "patched"
    folder.mkdir()
    catalog.publish("hall", folder, Manifest.for_directory(folder), build_id=build_id)
    assert catalog.active_version("hall") != version
    assert "patch" not in catalog.build_request(rebuild(catalog, "hall"))


def test_the_word_off_of_yaml_is_understood(tmp_path: Path):
    for text, mode in (("patch: off", "off"), ("patch: propose", "propose"), ("{}", "off")):
        (tmp_path / "config.yaml").write_text(text)
        assert BuildConfig.from_file(tmp_path / "config.yaml").patch == mode
    assert "patch" not in BuildConfig(patch="activate").to_mapping(), "it does not change the version"
