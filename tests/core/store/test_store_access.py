"""Stores that must not be written, and keys that change while the process runs."""

from __future__ import annotations

import secrets
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.errors import ReadOnly, StoreError, StoreUnavailable
from firstfix.store.aws_credentials import credentials_file
from firstfix.store.store import Store
from tests.servers import free_port, running_versitygw
from tests.waiting import let_pass

BUCKET = "maps"
REREAD_S = 0.5  # obstore goes on for a tenth of a second with what it has just read


@pytest.fixture
def gateway_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "gateway"
    (folder / "data" / BUCKET).mkdir(parents=True)
    return folder


@pytest.fixture
def no_keys(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    for name in ("ACCESS_KEY_ID", "SECRET_ACCESS_KEY", "SESSION_TOKEN", "PROFILE", "ENDPOINT_URL"):
        monkeypatch.delenv(f"AWS_{name}", raising=False)
    return monkeypatch


def s3_url(port: int) -> str:
    return f"s3://{BUCKET}?endpoint=http://127.0.0.1:{port}&region=us-east-1&allow_http=true"


@pytest.mark.parametrize(
    "any_store_url",
    ["file", "s3", pytest.param("azure", marks=pytest.mark.slow)],  # what is in memory is not shared
    indirect=True,
)
def test_a_read_only_store_reads_and_never_writes(any_store_url: str, tmp_path: Path):
    Store.open(any_store_url).put("a/b", b"content")
    store = Store.open(any_store_url, read_only=True)
    store.probe()
    assert store.get("a/b") == b"content"
    (tmp_path / "file").write_bytes(b"x")
    for write in (
        lambda: store.put("k", b""),
        lambda: store.put_new("k", b""),
        lambda: store.put_file("k", tmp_path / "file"),
        lambda: store.delete("a/b"),
    ):
        with pytest.raises(ReadOnly):
            write()
    assert store.list() == ["a/b"]


def test_a_read_only_directory_is_not_made(tmp_path: Path):
    with pytest.raises(StoreUnavailable):
        Store.open(str(tmp_path / "none"), read_only=True)
    assert not (tmp_path / "none").exists()


def test_a_server_that_takes_no_writes_serves_a_read_only_store(gateway_folder, no_keys, made, tmp_path):
    port, access, secret = free_port(), secrets.token_hex(8), secrets.token_hex(16)
    no_keys.setenv("AWS_ACCESS_KEY_ID", access)
    no_keys.setenv("AWS_SECRET_ACCESS_KEY", secret)
    with running_versitygw(gateway_folder, port, access, secret):
        version = Catalog(Store.open(s3_url(port))).publish("hall", *made)
    with running_versitygw(gateway_folder, port, access, secret, "--readonly"):
        with pytest.raises(StoreError):
            Store.open(s3_url(port)).probe()
        store = Store.open(s3_url(port), read_only=True)
        store.probe()
        fetched = Catalog(store).fetch_version("hall", version, tmp_path / "cache")
        assert (fetched / "a.npy").read_bytes() == b"content"


def test_rotated_keys_are_picked_up(gateway_folder: Path, no_keys: pytest.MonkeyPatch, tmp_path: Path):
    port, path = free_port(), tmp_path / "credentials"
    no_keys.setenv("AWS_SHARED_CREDENTIALS_FILE", str(path))
    no_keys.setenv("AWS_PROFILE", "robots")

    def hand_out(access: str, secret: str) -> None:
        path.write_text(f"[robots]\naws_access_key_id={access}\naws_secret_access_key={secret}\n")

    # The gateway says 404 to an id that it does not know, so only the secret changes.
    old, new = [("robot", secrets.token_hex(8) + "%" + secrets.token_hex(8)) for _ in range(2)]
    hand_out(*old)
    store = Store.open(s3_url(port))
    with running_versitygw(gateway_folder, port, *old):
        store.put("k", b"before")
    with running_versitygw(gateway_folder, port, *new):
        with pytest.raises(StoreError, match="credentials"):
            store.get("k")
        hand_out(*new)
        let_pass(REREAD_S)
        assert store.get("k") == b"before"
        path.unlink()
        let_pass(REREAD_S)
        with pytest.raises(StoreError) as caught:
            store.get("k")
        assert new[1] not in str(caught.value)


def test_keys_in_the_environment_come_first(tmp_path: Path):
    path = tmp_path / "credentials"
    path.write_text("[default]\naws_access_key_id = a\naws_secret_access_key = b\naws_session_token = c\n")
    named = {"AWS_SHARED_CREDENTIALS_FILE": str(path)}
    assert credentials_file({}) is None
    assert credentials_file({**named, "AWS_ACCESS_KEY_ID": "x"}) is None
    read = credentials_file(named)
    assert read is not None
    found = read()
    assert [found[name] for name in ("access_key_id", "secret_access_key", "token")] == ["a", "b", "c"]
    path.write_text("[other]\naws_secret_access_key = hunter2\n")
    with pytest.raises(ValueError, match="default") as caught:
        read()
    assert "hunter2" not in str(caught.value)
