"""gs:// against fake-gcs-server, which can be read over the API that obstore speaks, but not written."""

from __future__ import annotations

import hashlib
import uuid
from pathlib import Path

import httpx
import pytest

from firstfix.errors import NotFound, StoreError
from firstfix.store.store import Store
from tests.cloud_servers import CONTAINER


@pytest.fixture
def gcs(fake_gcs: str) -> Store:
    """A store with the objects a/one, a/two and b."""
    prefix = uuid.uuid4().hex
    for key in ("a/one", "a/two", "b"):
        httpx.post(
            f"{fake_gcs}/upload/storage/v1/b/{CONTAINER}/o",
            params={"uploadType": "media", "name": f"{prefix}/{key}"},
            content=key.encode(),
        ).raise_for_status()
    return Store.open(f"gs://{CONTAINER}/{prefix}?endpoint={fake_gcs}&allow_http=true")


def test_what_is_there_is_found_and_read(gcs: Store, tmp_path: Path) -> None:
    assert gcs.list() == ["a/one", "a/two", "b"]
    assert gcs.list("a") == ["a/one", "a/two"]
    assert gcs.folders() == ["a"]
    assert gcs.get("a/two") == b"a/two"
    assert gcs.get_range("a/two", 2, 100) == b"two"
    assert gcs.size("b") == 1
    assert gcs.download("a/one", tmp_path / "one") == hashlib.sha256(b"a/one").hexdigest()


def test_what_is_not_there_is_not_found(gcs: Store) -> None:
    for ask in (gcs.get, gcs.size, lambda key: gcs.get_range(key, 0, 1)):
        with pytest.raises(NotFound):
            ask("a/three")


def test_a_server_without_the_puts_is_refused(gcs: Store) -> None:
    with pytest.raises(StoreError):
        gcs.probe()
    assert gcs.list() == ["a/one", "a/two", "b"]
