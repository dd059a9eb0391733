"""Stores without create-only puts are refused with a reason: servers that ignore or refuse If-None-Match."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from firstfix.errors import StoreError, StoreUnavailable, StoreUnsafe
from firstfix.store.store import Store
from tests.s3_stand_in import Way, s3_stand_in
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow


def test_a_store_with_create_only_puts_is_taken():
    with s3_stand_in("honours") as server:
        store = Store.open(server.url)
        store.probe()
        assert (store.put_new("k", b"1"), store.put_new("k", b"2")) == (True, False)
        assert store.get("k") == b"1"
        assert store.list() == ["k"], "the probe leaves nothing"


@pytest.mark.parametrize(
    ("way", "says"),
    [
        ("ignores", "let a create-only put replace an object"),
        ("412", "a create-only put made no object"),
        ("501", "refuses create-only puts.*501 Not Implemented"),
        ("400", "refuses create-only puts.*400 Bad Request"),
        ("405", "refuses create-only puts.*405 Method Not Allowed"),
    ],
)
def test_a_store_without_create_only_puts_is_refused(way: Way, says: str):
    with s3_stand_in(way) as server:
        with pytest.raises(StoreUnsafe, match=says) as caught:
            Store.open(server.url).probe()
        assert "honours If-None-Match" in str(caught.value)
        assert not server.objects, "the probe leaves nothing"


def test_a_store_that_refuses_everything_is_not_called_unsafe(monkeypatch: pytest.MonkeyPatch):
    with s3_stand_in("503") as server:
        monkeypatch.setattr(server, "put", lambda *_: 503)
        with pytest.raises(StoreUnavailable):
            Store.open(server.url).probe()
    with s3_stand_in("403") as server, pytest.raises(StoreError, match="refuses these credentials") as caught:
        Store.open(server.url).probe()
    assert not isinstance(caught.value, StoreUnsafe)


def test_a_store_that_fails_for_a_moment_is_not_called_unsafe(monkeypatch: pytest.MonkeyPatch):
    with s3_stand_in("400") as server:
        store = Store.open(server.url)
        put = store.put

        def recover(key: str, data: bytes) -> None:
            server.way = "honours"
            put(key, data)

        monkeypatch.setattr(store, "put", recover)
        with pytest.raises(StoreUnavailable):
            store.probe()
        store.probe()


@pytest.fixture
def switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """The setting that people give servers without If-None-Match."""
    monkeypatch.setenv("AWS_CONDITIONAL_PUT", "disabled")


def test_switched_off_create_only_puts_are_unsafe(switched_off: None):
    with s3_stand_in("honours") as server:
        store = Store.open(server.url)
        for attempt in (store.probe, lambda: store.put_new("a", b"1")):
            with pytest.raises(StoreUnsafe, match="conditional put is disabled"):
                attempt()
        assert not server.objects
        store.put("a", b"1")
        assert store.get("a") == b"1"


@contextmanager
def started(folder: Path, *command: str) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """A command of firstfix and its log. It is killed at the end."""
    folders = {"FIRSTFIX_WORK_DIR": str(folder), "FIRSTFIX_CACHE_DIR": str(folder)}
    called, environment = [sys.executable, "-m", "firstfix_cli.main", *command], {**os.environ, **folders}
    with (
        (folder / "log").open("w") as log,
        subprocess.Popen(called, env=environment, stdout=log, stderr=log) as made,
    ):
        try:
            yield made, folder / "log"
        finally:
            made.kill()


def test_a_service_without_create_only_puts_says_so(switched_off: None, tmp_path: Path):
    """It ends, or says so again and again where that took it longer than a start may take."""
    serve = ["serve", "--port", "0"]
    with s3_stand_in("honours") as server, started(tmp_path, *serve, "--store", server.url) as (_, log):
        wait_until(lambda: "conditional put is disabled" in log.read_text())
    assert "Traceback" not in log.read_text()


def test_a_command_without_create_only_puts_says_so(switched_off: None, tmp_path: Path):
    create = ["keys", "create", "--name", "robot", "--scope", "localize"]
    with (
        s3_stand_in("honours") as server,
        started(tmp_path, *create, "--store", server.url) as (command, log),
    ):
        assert command.wait(LIMIT_S) != 0
    assert "conditional put is disabled" in log.read_text()
    assert "Traceback" not in log.read_text()
