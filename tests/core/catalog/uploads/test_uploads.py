from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firstfix.catalog.sources import source_key
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.errors import ChecksumMismatch, Conflict, InvalidOption, NotFound, StoreError, TooLarge
from firstfix.store.store import Store

DATA = bytes(range(256)) * 40


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def begun(uploads: Uploads, upload_id: str = "u1", data: bytes = DATA, digest: str | None = None) -> None:
    uploads.create(upload_id, size_bytes=len(data), file_name="hall.ply", sha256=digest)


def test_parts_become_a_source(any_store_url: str):
    store = Store.open(any_store_url)
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
def test_any_replica_goes_on_wherever_it_stopped(data: bytes, cuts: list[int], replicas: list[int]):
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


def test_of_two_writers_one_goes_on(any_store_url: str):
    store = Store.open(any_store_url)
    begun(Uploads(store))
    start = Uploads(store).get("u1")

    def write(writer: int) -> bool:
        with suppress(Conflict):
            Uploads(store).append(start, bytes([writer]) * (100 + writer))
            return True
        return False

    with ThreadPoolExecutor(8) as threads:
        won = list(threads.map(write, range(8)))
    assert won.count(True) == 1
    assert Uploads(store).get("u1").offset == 100 + won.index(True)


def test_a_reply_that_was_lost_is_no_conflict():
    uploads = Uploads(Store.open("memory://"))
    begun(uploads)
    start = uploads.get("u1")
    assert uploads.append(start, DATA[:100]) == uploads.append(start, DATA[:100])
    with pytest.raises(Conflict):
        uploads.append(start, DATA[:99])


def test_the_wrong_file_is_told_and_forgotten():
    uploads = Uploads(Store.open("memory://"))
    begun(uploads, digest="0" * 64)
    upload = uploads.append(uploads.get("u1"), DATA)
    with pytest.raises(ChecksumMismatch, match=sha256(DATA)):
        uploads.finish(upload)
    with pytest.raises(NotFound):
        uploads.get("u1")


def test_what_the_store_alters_does_not_become_a_source():
    store = Store.open("memory://")
    uploads = Uploads(store)
    begun(uploads)
    uploads.finish(uploads.append(uploads.get("u1"), DATA))
    store.put(f"uploads/u1/parts/{0:020d}", DATA[:-1] + b"x")
    with pytest.raises(StoreError, match="other bytes"):
        uploads.keep_as_source(uploads.get("u1"), "hall")
    assert store.list("maps") == []


def test_limits_and_names():
    uploads = Uploads(Store.open("memory://"))
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


def test_too_many_parts(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("firstfix.catalog.uploads.parts.MAX_PARTS", 3)
    uploads = Uploads(Store.open("memory://"))
    begun(uploads)
    upload = uploads.get("u1")
    for _ in range(3):
        upload = uploads.append(upload, b"x")
    with pytest.raises(TooLarge, match="parts"):
        uploads.append(upload, b"x")


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
        "overrun-first",
        "far-away",
        "no-number",
        "long",
        "deep",
    ],
)
def test_parts_that_nobody_appended_end_the_upload_there(objects: dict[str, bytes], offset: int):
    """A part of 0 bytes made ``get`` loop for ever."""
    store = Store.open("memory://")
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


def test_more_parts_than_there_may_be_are_not_counted(monkeypatch: pytest.MonkeyPatch):
    store = Store.open("memory://")
    begun(Uploads(store))
    for offset in range(5):
        store.put_new(part(offset), DATA[offset : offset + 1])
    monkeypatch.setattr("firstfix.catalog.uploads.parts.MAX_PARTS", 3)
    assert Uploads(store).get("u1").parts == (1, 1, 1)


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
def test_a_record_that_cannot_be_read_stands_in_nobodys_way(record: bytes):
    store = Store.open("memory://")
    uploads = Uploads(store)
    begun(uploads)
    store.put_new("uploads/u2/upload.json", record)
    store.put_new("uploads/u3/parts/00000000000000000000", b"a part without a record")
    assert set(uploads.announced()) == {"u1"}
    with pytest.raises(StoreError, match="u2"):
        uploads.get("u2")


def test_the_owner_is_in_the_record():
    store = Store.open("memory://")
    uploads = Uploads(store)
    uploads.create("u1", size_bytes=3, file_name="x", owner="key:a")
    uploads.create("u2", size_bytes=3, file_name="x")
    for _ in range(2):
        assert {name: r.owner for name, r in uploads.announced().items()} == {"u1": "key:a", "u2": None}
    assert (uploads.get("u1").owner, uploads.get("u2").owner) == ("key:a", None)
