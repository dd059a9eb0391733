"""The one store interface: a directory, memory, a real S3 server, Azurite, and fake-gcs-server (to read)."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from firstfix.errors import InvalidOption, NotFound, StoreError, StoreUnavailable, StoreUnsafe, TooLarge
from firstfix.store import backend as store_backend
from firstfix.store import store as store_module
from firstfix.store.store import Store
from firstfix.store.url import StoreUrl
from tests.cloud_servers import CONTAINER
from tests.core.fixtures import at_once


@pytest.fixture
def store(any_store_url: str) -> Store:
    return Store.open(any_store_url)


def test_an_object_is_put_got_and_deleted(store: Store):
    assert store.put_new("a/b.bin", b"one")
    assert not store.put_new("a/b.bin", b"two")
    assert store.get("a/b.bin") == b"one"
    store.put("a/b.bin", b"three")
    assert store.get("a/b.bin") == b"three"
    assert store.size("a/b.bin") == 5
    assert store.exists("a/b.bin")
    store.delete("a/b.bin")
    store.delete("a/b.bin")
    assert not store.exists("a/b.bin")


def test_a_missing_object_is_not_found(store: Store, tmp_path: Path):
    for ask in (store.get, store.size, lambda key: store.get_range(key, 0, 1)):
        with pytest.raises(NotFound):
            ask("no/such")
    with pytest.raises(NotFound):
        store.download("no/such", tmp_path / "file")
    assert list(tmp_path.glob("*file*")) == []
    store.put("folder/object", b"")
    with pytest.raises(NotFound):
        store.get("folder")


def test_one_of_sixteen_simultaneous_puts_wins(store: Store):
    for key in ("race/0", "race/1", "race/2", "race/3", "race/4"):
        won = at_once(16, lambda writer, key=key: store.put_new(key, b"%02d" % writer * 1000))
        assert won.count(True) == 1
        assert store.get(key) == b"%02d" % won.index(True) * 1000


def test_a_range_is_cut_at_the_end(store: Store):
    store.put("k", b"0123456789")
    assert store.get_range("k", 2, 3) == b"234"
    assert store.get_range("k", 8, 100) == b"89"
    for start, length in ((10, 1), (-1, 2), (0, 0)):
        with pytest.raises(InvalidOption):
            store.get_range("k", start, length)


def test_files_go_up_and_down_in_pieces(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(store_module, "CHUNK_BYTES", 1 << 20)
    content = bytes(range(256)) * 40_000 + b"end"  # over obstore's 5 MB: several parts
    source = tmp_path / "source"
    source.write_bytes(content)
    assert store.put_file("big", source)
    assert store.size("big") == len(content)
    assert not store.put_file("big", source)
    target = tmp_path / "target"
    assert store.download("big", target) == hashlib.sha256(content).hexdigest()
    assert target.read_bytes() == content
    (tmp_path / "empty").write_bytes(b"")
    assert store.put_file("empty", tmp_path / "empty")
    assert store.download("empty", target) == hashlib.sha256(b"").hexdigest()
    assert target.read_bytes() == b""
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("damaged", [b"dam", b"whore"])
def test_putting_a_file_replaces_a_damaged_object(store: Store, tmp_path: Path, damaged: bytes):
    (tmp_path / "whole").write_bytes(b"whole")
    store.put("k", damaged)
    assert store.put_file("k", tmp_path / "whole")
    assert store.get("k") == b"whole"
    assert not store.put_file("k", tmp_path / "whole")


def test_a_listing_is_of_one_folder_and_sorted(store: Store):
    for key in ("m/b/2", "m/b/1", "m/bc/1", "m/a", "z"):
        store.put(key, b"xy")
    assert store.list("m/b") == store.list("m/b/") == ["m/b/1", "m/b/2"]
    assert store.list() == ["m/a", "m/b/1", "m/b/2", "m/bc/1", "z"]
    assert store.list("none") == store.folders("none") == []
    assert store.folders("m") == ["b", "bc"]
    assert store.folders() == ["m"]
    assert [item.size_bytes for item in store.scan("m/b")] == [2, 2]
    assert store.list("m", after="m/b/1") == ["m/b/2", "m/bc/1"]
    assert store.list("m/b", after="m/b/2") == []


def test_a_listing_goes_past_the_thousand_of_one_page(s3_url: str):
    store = Store.open(s3_url)
    keys = [f"many/{i:04d}" for i in range(1005)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda key: store.put(key, b""), keys))
    assert store.list("many") == keys


@pytest.mark.parametrize(
    "key",
    [
        "",
        "a b",
        "a\0",
        "a" * 999,
        *[r"/a", r"a/", r"a//b", r"../a", r"a/../b", r"a/.", r".hidden", r"a%2e", r"a\b", r"é"],
    ],
)
def test_a_key_that_some_store_would_change_is_refused(store: Store, key: str):
    for call in (store.get, store.delete, lambda key: store.put_new(key, b""), store.local_path):
        with pytest.raises(InvalidOption):
            call(key)


def test_the_probe_leaves_nothing(store: Store):
    store.probe()
    assert store.list() == []


def test_the_probe_finds_a_store_that_overwrites():
    class Careless(Store):
        def put_new(self, key: str, data: bytes | Path) -> bool:
            assert isinstance(data, bytes)
            self.put(key, data)
            return True

    class Lying(Careless):
        def put_new(self, key: str, data: bytes | Path) -> bool:
            new = not self.exists(key)
            super().put_new(key, data)
            return new

    for kind in (Careless, Lying):
        with pytest.raises(StoreUnsafe):
            kind.open("memory://").probe()


def test_a_file_store_lends_its_files_and_others_do_not(tmp_path: Path):
    store = Store.open(str(tmp_path / "new" / "folder"))
    store.put("a/b", b"content")
    path = store.local_path("a/b")
    assert path is not None
    assert path.read_bytes() == b"content"
    with pytest.raises(NotFound):
        store.local_path("a")
    other = Store.open("memory://")
    other.put("a/b", b"")
    assert other.local_path("a/b") is None
    assert not Store.open("memory://").exists("a/b"), "two in memory share nothing"
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StoreUnavailable):
        Store.open(str(tmp_path / "file" / "below"))


def test_a_prefix_is_a_folder_of_its_own(s3_url: str):
    inner = Store.open(s3_url)
    outer = Store.open(s3_url.replace("?", "/deeper?"))
    outer.put("k", b"deep")
    assert inner.list() == ["deeper/k"]
    assert outer.list() == ["k"]


def test_an_unreachable_store_is_unavailable_soon(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "nobody")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "sesame")
    monkeypatch.setattr(store_backend, "_RETRY", {"max_retries": 1})
    store = Store.open("s3://bucket?endpoint=http://127.0.0.1:9&allow_http=true&region=r")
    for call in (store.get, store.list, store.exists, lambda key: store.put_new(key, b"")):
        with pytest.raises(StoreUnavailable) as caught:
            call("k")
        assert "sesame" not in str(caught.value)
        assert "\n" not in str(caught.value)


def test_wrong_credentials_and_a_missing_bucket_are_told_apart(s3_url: str, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(StoreUnavailable):
        Store.open(s3_url.replace("s3://firstfix-tests", "s3://no-such-bucket")).probe()
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "wrong")
    with pytest.raises(StoreError, match="credentials"):
        Store.open(s3_url).probe()


@pytest.mark.parametrize(
    "url",
    [
        "",
        "ftp://host/x",
        "s3://",
        "s3://bucket?endpont=x",
        "s3://bucket?allow_http=perhaps",
        "s3://key:secret@bucket",
        "s3://bucket?secret_access_key=hunter2",
        "file://host/dir",
        "file:///dir?region=x",
        "memory://?region=x",
        "az://container",
    ],
)
def test_an_invalid_url_is_refused(url: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("AZURE_STORAGE_ACCOUNT_NAME", raising=False)
    with pytest.raises(InvalidOption) as caught:
        Store.open(url)
    assert "hunter2" not in str(caught.value)


def test_every_cloud_opens_by_its_url(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", "bm8ga2V5")
    for url in (
        "s3://bucket/prefix?region=eu-west-1&virtual_hosted_style_request=true",
        "gs://bucket/prefix?skip_signature=true&endpoint=http://127.0.0.1:9&allow_http=1",
        "az://container/prefix?account_name=someone",
    ):
        assert isinstance(Store.open(url), Store)
    assert StoreUrl.parse("s3a://b/p/q/").prefix == "p/q"
    assert StoreUrl.parse("file:///a%20b").prefix == "/a b"
    assert StoreUrl.parse("relative").prefix == str(Path.cwd() / "relative")


def test_equal_urls_have_one_identity(tmp_path: Path):
    def identity(url: str, **environment: str) -> str:
        return StoreUrl.parse(url).identity(environment)

    (tmp_path / "maps").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "maps")
    assert (
        identity(f"{tmp_path}/maps") == identity(f"file://{tmp_path}/link/") != identity(f"{tmp_path}/other")
    )
    assert identity("s3a://b/p/") == identity("s3://b/p?region=eu") != identity("s3://b/q")
    there = identity("s3://b/p?endpoint=https://host/")
    assert there == identity("s3://b/p", AWS_ENDPOINT_URL="https://host")
    assert there == identity("s3://b/p", AWS_ENDPOINT="https://host", AWS_REGION="eu")
    assert there == identity("s3://b/p?endpoint=https://host", AWS_ENDPOINT="https://other")
    assert there != identity("s3://b/p")
    named = identity("az://c/p?account_name=mine")
    assert named == identity("az://c/p", AZURE_STORAGE_ACCOUNT_NAME="mine") != identity("az://c/p")
    assert identity("az://c?use_emulator=true") == identity("az://c?use_emulator=1") != identity("az://c")
    assert "secret" not in identity("s3://b", AWS_SECRET_ACCESS_KEY="secret")


def test_leftovers_of_killed_processes_alone_are_removed(tmp_path: Path):
    store = Store.open(f"file://{tmp_path}")
    store.put("maps/hall/a", b"a")
    store.put("probe/left", b"first")
    (tmp_path / "maps" / "hall" / "b#1").write_bytes(b"half of b")
    assert store.remove_leftovers(older_than_s=60) == [], "they may be under way"
    assert store.remove_leftovers(older_than_s=0, dry_run=True) == ["probe/left", "maps/hall/b#1"]
    assert store.remove_leftovers(older_than_s=0) == ["probe/left", "maps/hall/b#1"]
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["a"]


def test_a_file_store_keeps_no_empty_folders(tmp_path: Path):
    store = Store.open(str(tmp_path))
    store.put("builds/b1/parts/1", b"x")
    store.put("builds/b2/status.json", b"x")
    store.delete("builds/b1/parts/1")
    store.delete("builds/b1/parts/1")
    assert store.folders("builds") == ["b2"]
    store.delete("builds/b2/status.json")
    assert (tmp_path / "builds").is_dir()
    assert store.put_new("builds/b1/parts/1", b"y")


def test_an_object_of_pieces_is_there_whole_or_not_at_all(store: Store):
    store.put("first", b"first")

    def pieces(fails: bool) -> Iterator[bytes]:
        for n in range(12):
            if fails and n == 11:
                raise ValueError("no more")
            yield store.get("first") + bytes([n]) * (2 << 20)  # its maker may ask the store

    with pytest.raises(ValueError, match="no more"):
        store.put_pieces("whole", pieces(True))
    assert not store.exists("whole")
    store.put_pieces("whole", pieces(False))
    assert store.get("whole") == b"".join(pieces(False))


def test_an_object_over_the_limit_is_not_read(store: Store):
    store.put("k", b"x" * 1000)
    assert store.get("k", max_bytes=1000) == b"x" * 1000
    with pytest.raises(TooLarge):
        store.get("k", max_bytes=999)


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


def test_gcs_objects_are_listed_and_read(gcs: Store, tmp_path: Path):
    assert gcs.list() == ["a/one", "a/two", "b"]
    assert gcs.list("a") == ["a/one", "a/two"]
    assert gcs.folders() == ["a"]
    assert gcs.get("a/two") == b"a/two"
    assert gcs.get_range("a/two", 2, 100) == b"two"
    assert gcs.size("b") == 1
    for ask in (gcs.get, gcs.size, lambda key: gcs.get_range(key, 0, 1)):
        with pytest.raises(NotFound):
            ask("a/three")
    assert gcs.download("a/one", tmp_path / "one") == hashlib.sha256(b"a/one").hexdigest()


def test_a_gcs_server_without_the_puts_is_refused(gcs: Store):
    with pytest.raises(StoreError):
        gcs.probe()
    assert gcs.list() == ["a/one", "a/two", "b"]
