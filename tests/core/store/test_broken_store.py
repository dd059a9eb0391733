"""Publishing and fetching over a link that breaks in the middle: a real S3 server behind toxiproxy."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.errors import NotFound, StoreUnavailable
from firstfix.store import backend as store_backend
from firstfix.store.store import Store
from tests.toxiproxy import Link

pytestmark = pytest.mark.slow

CONTENT = {"a.bin": os.urandom(200_000), "b.bin": os.urandom(100_000), "c.txt": b"small"}


@pytest.fixture
def made(tmp_path: Path) -> Path:
    folder = tmp_path / "made"
    folder.mkdir()
    for name, content in CONTENT.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture(autouse=True)
def gives_up_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_backend, "_RETRY", {"max_retries": 0})


@pytest.mark.parametrize("sent_bytes", [0, 1_000, 150_000, 250_000, 302_000, 304_000, 306_000, 308_000])
def test_a_publish_that_is_cut_off_is_not_seen_and_can_be_repeated(
    broken_s3: tuple[str, Link], s3_url: str, made: Path, tmp_path: Path, sent_bytes: int
):
    url, link = broken_s3
    direct, manifest = Catalog(Store.open(s3_url)), Manifest.for_directory(made)
    publisher = Catalog(Store.open(url))
    link.poison("limit_data", "upstream", bytes=sent_bytes)  # of every connection
    try:
        publisher.publish("hall", made, manifest)
        published = True
    except StoreUnavailable:
        published = False
    if direct.active_version("hall") is None:
        assert not published
        with pytest.raises(NotFound):
            direct.fetch_version("hall", manifest.digest, tmp_path / "cache")
    link.mend()
    assert publisher.publish("hall", made, manifest) == manifest.digest
    fetched = direct.fetch_version("hall", manifest.digest, tmp_path / "cache")
    assert {path.name: path.read_bytes() for path in fetched.iterdir()} == CONTENT
    assert [entry.event.value for entry in direct.log("hall")] == ["published", "activated"]


@pytest.mark.parametrize("received_bytes", [0, 1_000, 50_000, 150_000, 200_000])
def test_a_fetch_that_is_cut_off_shows_nothing(broken_s3, s3_url, made, tmp_path, received_bytes):
    url, link = broken_s3
    version = Catalog(Store.open(s3_url)).publish("hall", made, Manifest.for_directory(made))
    reader, cache = Catalog(Store.open(url)), tmp_path / "cache"
    reader.manifest("hall", version)
    link.poison("limit_data", bytes=received_bytes)
    with pytest.raises(StoreUnavailable):
        reader.fetch_version("hall", version, cache)
    assert not (cache / version).exists()
    link.mend()
    fetched = reader.fetch_version("hall", version, cache)
    assert {path.name: path.read_bytes() for path in fetched.iterdir()} == CONTENT


def test_a_short_cut_is_retried(broken_s3: tuple[str, Link], made, tmp_path, monkeypatch):
    monkeypatch.undo()  # with the retries that the service has
    url, link = broken_s3
    catalog = Catalog(Store.open(url))
    link.poison("reset_peer", timeout=0)
    threading.Timer(0.3, link.mend).start()
    version = catalog.publish("hall", made, Manifest.for_directory(made))
    assert (catalog.fetch_version("hall", version, tmp_path / "cache") / "c.txt").read_bytes() == b"small"
