"""The log of a map: numbered entries that many writers append to without losing one."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from firstfix.errors import Conflict
from firstfix.map_log import Event, MapLog, MapState
from firstfix.store import Store

A, B, C = "a" * 64, "b" * 64, "c" * 64
PUB, ACT, RET = Event.PUBLISHED, Event.ACTIVATED, Event.RETIRED


def _always(state: MapState) -> bool:
    return True


@pytest.mark.parametrize(
    ("events", "published", "activated"),
    [
        ([], (), ()),
        ([(PUB, A)], (A,), ()),
        ([(PUB, A), (ACT, A)], (A,), (A,)),
        ([(PUB, A), (ACT, A), (PUB, B), (ACT, B)], (A, B), (B, A)),
        ([(PUB, A), (ACT, A), (PUB, B), (ACT, B), (ACT, A)], (A, B), (A, B)),
        ([(PUB, A), (ACT, A), (PUB, B), (ACT, B), (RET, B)], (A,), (A,)),
        ([(PUB, A), (ACT, A), (RET, A)], (), ()),
        ([(PUB, A), (RET, A), (ACT, A)], (), ()),  # what is not there cannot become active
        ([(PUB, A), (ACT, A), (RET, A), (PUB, A)], (A,), ()),
        ([(PUB, A), (PUB, A)], (A,), ()),
    ],
)
def test_what_a_log_adds_up_to(
    events: list[tuple[Event, str]], published: tuple[str, ...], activated: tuple[str, ...]
) -> None:
    log = MapLog(Store.open("memory://"), "log")
    for event, version in events:
        log.append(event, version, needed=_always)
    state = log.state()
    assert (state.published, state.activated) == (published, activated)
    assert state.active == (activated[0] if activated else None)
    assert [(entry.seq, entry.event, entry.version) for entry in state.entries] == [
        (i, event, version) for i, (event, version) in enumerate(events, 1)
    ]


def test_racing_writers_lose_no_entry(any_store_url: str) -> None:
    store = Store.open(any_store_url)
    versions = [f"{i:064x}" for i in range(40)]

    def write(version: str) -> None:
        # each with a log of its own, as in processes of their own
        MapLog(store, "log").append(PUB, version, needed=_always)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, versions))
    state = MapLog(store, "log").state()
    assert sorted(state.published) == versions
    assert [entry.seq for entry in state.entries] == list(range(1, 41))
    assert store.list("log") == [f"log/{i:06d}.json" for i in range(1, 41)]


@pytest.mark.parametrize("shared", [False, True])
def test_the_precondition_holds_for_the_very_state_before_the_entry(shared: bool) -> None:
    store = Store.open("memory://")
    logs = [MapLog(store, "log")] * 16 if shared else [MapLog(store, "log") for _ in range(16)]
    start = threading.Barrier(16)

    def first_only(state: MapState) -> bool:
        return not state.published

    def write(i: int) -> bool:
        start.wait()
        return logs[i].append(PUB, f"{i:064x}", needed=first_only) is not None

    with ThreadPoolExecutor(16) as pool:
        assert list(pool.map(write, range(16))).count(True) == 1
    assert len(MapLog(store, "log").state().entries) == 1


def test_a_refusal_writes_nothing() -> None:
    store = Store.open("memory://")

    def refuse(state: MapState) -> bool:
        raise Conflict("no")

    with pytest.raises(Conflict):
        MapLog(store, "log").append(PUB, A, needed=refuse)
    assert store.list() == []


def test_a_writer_whose_reply_was_lost_writes_once() -> None:
    class LosesReplies(Store):
        def put_new(self, key: str, data: bytes | Path) -> bool:
            super().put_new(key, data)
            return False  # what the client's own retry would hear

    store = LosesReplies.open("memory://")
    entry = MapLog(store, "log").append(PUB, A, needed=_always)
    assert entry is not None
    assert entry.seq == 1
    assert len(MapLog(store, "log").state().entries) == 1


TIME = "2026-01-01T00:00:00+00:00"


@pytest.mark.parametrize(
    "data",
    [
        "",
        "{",
        "[]",
        f'{{"event":"blessed","version":"{A}","time":"{TIME}"}}',
        f'{{"event":"published","version":"x","time":"{TIME}"}}',
        f'{{"event":"published","version":"{A}","time":"2026-01-01T00:00:00"}}',
    ],
)
def test_an_unreadable_entry_is_passed_over_and_not_overwritten(
    data: str, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store.open("memory://")
    log = MapLog(store, "log")
    log.append(PUB, A, needed=_always)
    store.put("log/000002.json", data.encode())
    store.put("log/readme.txt", b"not an entry")
    log.append(ACT, A, needed=_always)
    assert [entry.seq for entry in log.state().entries] == [1, 3]
    assert log.state().active == A
    assert store.get("log/000002.json") == data.encode()
    assert "000002" in caplog.text


def test_a_reader_sees_what_others_write() -> None:
    store = Store.open("memory://")
    reader = MapLog(store, "log")
    assert reader.state() == MapState()
    MapLog(store, "log").append(PUB, C, needed=_always)
    assert reader.state().published == (C,)
