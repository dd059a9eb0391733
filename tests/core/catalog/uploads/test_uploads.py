"""Uploads: parts become a source, whoever writes, fails or removes them meanwhile."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firstfix.catalog.sources import source_key
from firstfix.catalog.uploads.uploads import SWEPT_AT_ONCE, Uploads
from firstfix.errors import ChecksumMismatch, Conflict, InvalidOption, NotFound, StoreError, TooLarge
from firstfix.store.store import Store
from tests.core.fixtures import at_once
from tests.interleavings import Step, run_every_order, run_interleaved

DATA = bytes(range(256)) * 40


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def begun(uploads: Uploads, upload_id: str = "u1", data: bytes = DATA, digest: str | None = None) -> None:
    uploads.create(upload_id, size_bytes=len(data), file_name="hall.ply", sha256=digest)


def test_parts_become_a_source(any_store: Store):
    store = any_store
    uploads = Uploads(store)
    begun(uploads, digest=sha256(DATA))
    upload = uploads.get("u1")
    assert (upload.offset, upload.complete, upload.file_name) == (0, False, "hall.ply")
    for start in range(0, len(DATA), 3000):
        upload = uploads.append(upload, DATA[start : start + 3000])
    assert upload.complete
    assert uploads.get("u1").parts == upload.parts
    assert uploads.keep_as_source(uploads.get("u1"), "hall") == sha256(DATA)
    assert store.get(source_key("hall", sha256(DATA))) == DATA
    assert uploads.keep_as_source(uploads.get("u1"), "hall") == sha256(DATA), "again is the same"
    uploads.remove("u1")
    assert store.list("uploads") == []
    with pytest.raises(NotFound):
        uploads.get("u1")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(
    data=st.binary(min_size=1, max_size=400),
    cuts=st.lists(st.integers(0, 400), max_size=8),
    replicas=st.lists(st.integers(0, 2), min_size=1, max_size=10),
)
def test_any_replica_continues_an_upload(data: bytes, cuts: list[int], replicas: list[int]):
    """The file is the same, however it is cut and whichever replica takes each part."""
    store = Store.open("memory://")
    several = [Uploads(store) for _ in range(3)]
    begun(several[0], data=data)
    ends = [*sorted(cut for cut in cuts if cut < len(data)), len(data)]
    for turn, end in enumerate(ends):
        uploads = several[replicas[turn % len(replicas)]]
        upload = uploads.get("u1")
        uploads.append(upload, data[upload.offset : end])
    last = several[replicas[-1]]
    assert last.finish(last.get("u1")) == sha256(data)
    last.keep_as_source(last.get("u1"), "hall")
    assert store.get(source_key("hall", sha256(data))) == data


def test_one_of_many_writers_of_a_part_wins(any_store: Store):
    store = any_store
    begun(Uploads(store))
    start = Uploads(store).get("u1")

    def write(writer: int) -> bool:
        with suppress(Conflict):
            Uploads(store).append(start, bytes([writer]) * (100 + writer))
            return True
        return False

    won = at_once(8, write)
    assert won.count(True) == 1
    assert Uploads(store).get("u1").offset == 100 + won.index(True)


def test_a_lost_reply_is_no_conflict(store: Store):
    uploads = Uploads(store)
    begun(uploads)
    start = uploads.get("u1")
    assert uploads.append(start, DATA[:100]) == uploads.append(start, DATA[:100])
    with pytest.raises(Conflict):
        uploads.append(start, DATA[:99])


def test_a_wrong_file_is_named_and_forgotten(store: Store):
    uploads = Uploads(store)
    begun(uploads, digest="0" * 64)
    upload = uploads.append(uploads.get("u1"), DATA)
    with pytest.raises(ChecksumMismatch, match=sha256(DATA)):
        uploads.finish(upload)
    with pytest.raises(NotFound):
        uploads.get("u1")


def test_bytes_altered_by_the_store_do_not_become_a_source(store: Store):
    uploads = Uploads(store)
    begun(uploads)
    uploads.finish(uploads.append(uploads.get("u1"), DATA))
    store.put(f"uploads/u1/parts/{0:020d}", DATA[:-1] + b"x")
    with pytest.raises(StoreError, match="other bytes"):
        uploads.keep_as_source(uploads.get("u1"), "hall")
    assert store.list("maps") == []


def test_limits_and_names_are_checked(store: Store):
    uploads = Uploads(store)
    begun(uploads)
    with pytest.raises(Conflict):
        begun(uploads)
    with pytest.raises(TooLarge):
        uploads.append(uploads.get("u1"), DATA + b"x")
    with pytest.raises(Conflict, match="0 of its"):
        uploads.finish(uploads.get("u1"))
    with pytest.raises(InvalidOption):
        uploads.get("../maps")
    with pytest.raises(InvalidOption):
        begun(uploads, "u2", digest="short")
    uploads.remove("never-was")
    assert uploads.ids() == ["u1"]


def part(offset: int | str) -> str:
    return f"uploads/u1/parts/{offset:0>20}"


@pytest.mark.parametrize(
    ("objects", "offset"),
    [
        ({part(0): b""}, 0),
        ({part(0): DATA[:100], part(100): b""}, 100),
        ({part(0): DATA[:100], part(50): DATA[50:150], part(100): DATA[100:200]}, 200),
        ({part(0): DATA[:100], part(100): bytes(len(DATA) - 99)}, 100),
        ({part(0): bytes(len(DATA) + 1)}, 0),
        ({part(0): DATA[:100], part("9" * 20): b"x", part(len(DATA)): b"x"}, 100),
        ({part(0): DATA[:100], "uploads/u1/parts/first": b"x", "uploads/u1/parts/0": b"x"}, 100),
        ({"uploads/u1/parts/" + "1" * 150: b"x"}, 0),
        ({part(0): DATA[:100], "uploads/u1/parts/00000000000000000100/x": b"x"}, 100),
    ],
    ids=[
        "empty",
        "empty-later",
        "overlap",
        "overrun",
        "first",
        "far",
        "no-number",
        "long",
        "deep",
    ],
)
def test_invalid_parts_end_the_upload_there(store: Store, objects: dict[str, bytes], offset: int):
    uploads = Uploads(store)
    begun(uploads)
    for key, data in objects.items():
        store.put_new(key, data)
    upload = uploads.get("u1")
    assert upload.offset == offset
    whole = uploads.append(upload, DATA[offset:])
    assert uploads.finish(whole) == sha256(DATA)
    assert uploads.get("u1").complete
    uploads.keep_as_source(uploads.get("u1"), "hall")
    assert store.get(source_key("hall", sha256(DATA))) == DATA


def test_too_many_parts_are_refused_and_not_counted(store: Store, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("firstfix.catalog.uploads.parts.MAX_PARTS", 3)
    uploads = Uploads(store)
    begun(uploads)
    upload = uploads.get("u1")
    for _ in range(3):
        upload = uploads.append(upload, b"x")
    with pytest.raises(TooLarge, match="parts"):
        uploads.append(upload, b"x")
    for offset in (3, 4):
        store.put_new(part(offset), b"x")
    assert uploads.get("u1").parts == (1, 1, 1)


def test_a_part_is_bounded(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("firstfix.catalog.uploads.parts.PART_BYTES", 100)
    store = Store.open("memory://")
    uploads = Uploads(store)
    begun(uploads)
    with pytest.raises(TooLarge, match="at most 100"):
        uploads.append(uploads.get("u1"), bytes(101))
    store.put_new(part(0), bytes(101))
    assert uploads.get("u1").offset == 0, "no append wrote it, and to read it would take its memory"


@pytest.mark.parametrize(
    "record", [b"", b"[]", b"{}", b'{"size_bytes": "x", "file_name": "a", "sha256": null}']
)
def test_an_unreadable_record_hides_no_other_upload(store: Store, record: bytes):
    uploads = Uploads(store)
    begun(uploads)
    store.put_new("uploads/u2/upload.json", record)
    store.put_new("uploads/u3/parts/00000000000000000000", b"a part without a record")
    assert set(uploads.announced()) == {"u1"}
    with pytest.raises(StoreError, match="u2"):
        uploads.get("u2")


def test_the_owner_is_in_the_record(store: Store):
    uploads = Uploads(store)
    uploads.create("u1", size_bytes=3, file_name="x", owner="key:a")
    uploads.create("u2", size_bytes=3, file_name="x")
    for _ in range(2):
        assert {name: r.owner for name, r in uploads.announced().items()} == {"u1": "key:a", "u2": None}
    assert (uploads.get("u1").owner, uploads.get("u2").owner) == ("key:a", None)


SHORT = bytes(range(200))


def appended(store: Store, *, before: int = 100) -> Callable[[], Any]:
    """One more part, of a file that has a first one."""
    uploads = Uploads(store)
    uploads.create("u1", size_bytes=len(SHORT), file_name="hall.ply", owner="key:a")
    upload = uploads.append(uploads.get("u1"), SHORT[:before])
    return lambda: uploads.append(upload, SHORT[before:]) if before < len(SHORT) else uploads.finish(upload)


def finished(store: Store) -> Callable[[], Any]:
    """The check of a file that is complete."""
    return appended(store, before=len(SHORT))


def works(writer: Callable[[Store], Callable[[], Any]], store: Store) -> list[Callable[[], Any]]:
    write = writer(store)

    def write_until_removed() -> None:
        with suppress(NotFound):
            write()

    return [write_until_removed, lambda: Uploads(store).remove("u1")]


@pytest.mark.parametrize("writer", [appended, finished])
def test_a_removed_upload_leaves_nothing_in_every_order(writer, monkeypatch):
    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        actors = works(writer, store)
        steps = run_interleaved(actors, switches, monkeypatch=monkeypatch)
        assert store.list("uploads") == []
        return steps

    run_every_order(run)


@pytest.mark.parametrize("killed", ["writer", "remover"])
@pytest.mark.parametrize("writer", [appended, finished])
def test_leftovers_of_a_kill_go_with_the_next_look(writer, killed, monkeypatch):
    def run(kill_at: int, switches: tuple[int, ...]) -> int:
        store = Store.open("memory://")
        actors = works(writer, store)
        if killed == "remover":
            actors.reverse()
        steps = run_interleaved(actors, switches, kill_at=kill_at, monkeypatch=monkeypatch)
        if not store.exists("uploads/u1/upload.json"):
            assert Uploads(store).announced() == {}
            assert store.list("uploads") == []
        return sum(step.actor == 0 for step in steps)

    calls = run(1_000_000, ())
    for kill_at in range(calls):
        for begin in range(kill_at + 2):
            run(kill_at, (begin,))


def test_a_part_that_comes_after_the_removal_is_refused(store: Store):
    late = appended(store)
    Uploads(store).remove("u1")
    with pytest.raises(NotFound, match="u1"):
        late()
    assert store.list("uploads") == []


def test_announced_removes_some_leftovers_and_no_upload(store: Store):
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
