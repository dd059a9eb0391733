"""Uploads that are removed while another request writes to them: nothing of them stays in the store."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from firstfix.catalog.uploads.uploads import SWEPT_AT_ONCE, Uploads
from firstfix.errors import NotFound
from firstfix.store.store import Store
from tests.interleavings import Step, run_every_order, run_interleaved

DATA = bytes(range(200))


def appended(store: Store) -> Callable[[], Any]:
    """One more part, of a file that has a first one."""
    uploads = Uploads(store)
    uploads.create("u1", size_bytes=len(DATA), file_name="hall.ply", owner="key:a")
    upload = uploads.append(uploads.get("u1"), DATA[:100])
    return lambda: uploads.append(upload, DATA[100:])


def finished(store: Store) -> Callable[[], Any]:
    """The check of a file that is complete."""
    uploads = Uploads(store)
    uploads.create("u1", size_bytes=len(DATA), file_name="hall.ply", owner="key:a")
    upload = uploads.append(uploads.get("u1"), DATA)
    return lambda: uploads.finish(upload)


def ended(work: Callable[[], Any]) -> Callable[[], None]:
    def run() -> None:
        with suppress(NotFound):
            work()

    return run


WRITERS = [appended, finished]


@pytest.mark.parametrize("writer", WRITERS)
def test_nothing_is_left_of_a_removed_upload_whatever_comes_first(
    writer: Callable[[Store], Callable[[], Any]], monkeypatch: pytest.MonkeyPatch
):
    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        works = [ended(writer(store)), lambda: Uploads(store).remove("u1")]
        steps = run_interleaved(works, switches, monkeypatch=monkeypatch)
        assert store.list("uploads") == []
        return steps

    run_every_order(run)


@pytest.mark.parametrize("killed", ["writer", "remover"])
@pytest.mark.parametrize("writer", WRITERS)
def test_what_a_kill_leaves_goes_with_the_next_look(
    writer: Callable[[Store], Callable[[], Any]], killed: str, monkeypatch: pytest.MonkeyPatch
):
    def run(kill_at: int, switches: tuple[int, ...]) -> int:
        store = Store.open("memory://")
        works = [ended(writer(store)), lambda: Uploads(store).remove("u1")]
        if killed == "remover":
            works.reverse()
        steps = run_interleaved(works, switches, kill_at=kill_at, monkeypatch=monkeypatch)
        if not store.exists("uploads/u1/upload.json"):
            assert Uploads(store).announced() == {}
            assert store.list("uploads") == []
        return sum(step.actor == 0 for step in steps)

    calls = run(1_000_000, ())
    for kill_at in range(calls):
        for begin in range(kill_at + 2):
            run(kill_at, (begin,))


def test_a_part_that_comes_after_the_removal_is_refused():
    store = Store.open("memory://")
    late = appended(store)
    Uploads(store).remove("u1")
    with pytest.raises(NotFound, match="u1"):
        late()
    assert store.list("uploads") == []


def test_a_look_removes_some_leftovers_of_others_and_no_upload():
    store = Store.open("memory://")
    uploads = Uploads(store)
    uploads.create("u1", size_bytes=3, file_name="x", owner="key:a")
    uploads.append(uploads.get("u1"), b"abc")
    store.put_new("uploads/u2/upload.json", b"damaged")
    for offset in range(SWEPT_AT_ONCE + 5):
        store.put_new(f"uploads/u3/parts/{offset:020d}", b"a part without a record")
    assert set(uploads.announced()) == {"u1"}
    assert len(store.list("uploads/u3")) == 5, "one caller does not wait for all of it"
    assert set(uploads.announced()) == {"u1"}
    assert {key.split("/")[1] for key in store.list("uploads")} == {"u1", "u2"}
    whole = uploads.get("u1")
    assert uploads.finish(whole) == hashlib.sha256(b"abc").hexdigest()
