"""The base of a build: the active version, fetched whole, or none where it is gone or damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import MADE_BY_FILE, SURFACE_FILE, Manifest
from firstfix.store.store import Store
from firstfix_builder.job.base_source import collect_base, with_base
from tests.core.fixtures import make_version

FILES = {SURFACE_FILE: b"cells", MADE_BY_FILE: b"{}"}


@pytest.fixture
def catalog(tmp_path: Path) -> Catalog:
    return Catalog(Store.open(str(tmp_path / "store")))


def published(catalog: Catalog, folder: Path, *, provisional: bool = False) -> str:
    manifest = make_version(folder, b"content", FILES, provisional=provisional)
    return catalog.publish("hall", folder, manifest)


def test_the_active_version_is_the_base_unless_the_config_says_otherwise(catalog: Catalog, tmp_path: Path):
    assert with_base(catalog, "hall", {}) == {}
    version = published(catalog, tmp_path / "v")
    assert with_base(catalog, "hall", {"level": False}) == {"level": False, "base": version}
    assert with_base(catalog, "hall", {"exact": True})["base"] == version, "for chunks that are the same"
    assert with_base(catalog, "hall", {"base": "1" * 64}) == {"base": "1" * 64}


def test_a_provisional_version_is_no_base(catalog: Catalog, tmp_path: Path):
    published(catalog, tmp_path / "v", provisional=True)
    assert with_base(catalog, "hall", {}) == {}


def test_the_base_is_fetched_with_the_files_that_no_query_reads(catalog: Catalog, tmp_path: Path):
    version = published(catalog, tmp_path / "v")
    folder = collect_base(catalog, "hall", {"base": version}, tmp_path / "base")
    assert folder is not None
    manifest = Manifest.from_json((folder / "manifest.json").read_bytes())
    assert manifest.digest == version
    manifest.verify_directory(folder)
    (folder / "manifest.json").write_bytes(b"changed")
    (folder / SURFACE_FILE).write_bytes(b"changed")
    assert catalog.manifest("hall", version).digest == version, "the store has its own"
    assert catalog.read_file("hall", version, SURFACE_FILE, max_bytes=100) == b"cells"


@pytest.mark.parametrize("damage", ["gone", "retired", "surface", "query's file"])
def test_nothing_is_kept_of_a_version_that_is_gone_or_damaged(
    catalog: Catalog, tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
):
    version = published(catalog, tmp_path / "v")
    at = catalog.folder_of("hall", version).key
    if damage == "gone":
        version = "0" * 64
    elif damage == "retired":
        catalog.retire("hall", version, force=True)
    else:
        catalog.store.put(f"{at}/{SURFACE_FILE if damage == 'surface' else 'a.npy'}", b"other")
    assert collect_base(catalog, "hall", {"base": version}, tmp_path / "base") is None
    assert version[:12] in caplog.text
    assert not (tmp_path / "base").exists()


def test_without_a_base_nothing_is_fetched(catalog: Catalog, tmp_path: Path):
    published(catalog, tmp_path / "v")
    assert collect_base(catalog, "hall", {}, tmp_path / "base") is None
