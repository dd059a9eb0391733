"""The log of a map: numbered entries that many writers append to without losing one."""

from __future__ import annotations

import json
import random
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import ClassVar

import pytest

from firstfix.catalog.log.log_garbage import log_garbage
from firstfix.catalog.log.map_log import MapLog
from firstfix.catalog.log.map_state import HISTORY, MARKS, MAX_SKIPPED, Event, LogEntry, MapState
from firstfix.store.json_record import record_json
from firstfix.store.numbered import scan_after
from firstfix.store.store import Store, StoredObject
from tests.core.fixtures import at_once
from tests.frequent_snapshots import EVERY

A, B, C = "a" * 64, "b" * 64, "c" * 64
PUB, ACT, RET = Event.PUBLISHED, Event.ACTIVATED, Event.RETIRED
pytestmark = pytest.mark.usefixtures("frequent_snapshots")


def _always(state: MapState) -> bool:
    return True


def collect(store: Store) -> int:
    """Removes the garbage of the log as if a day had passed."""
    found = list(log_garbage(store, "log", datetime.now(timezone.utc) + timedelta(days=1)))
    for key in found:
        store.delete(key)
    return len(found)


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
def test_a_log_adds_up_to_its_published_and_activated_versions(events, published, activated):
    log = MapLog(Store.open("memory://"), "log")
    for event, version in events:
        log.append(event, version, needed=_always)
    state = log.state()
    assert (state.published, state.activated) == (published, activated)
    assert state.active == (activated[0] if activated else None)
    assert [(entry.seq, entry.event, entry.version) for entry in state.entries] == [
        (i, event, version) for i, (event, version) in enumerate(events, 1)
    ]


def test_racing_writers_lose_no_entry(any_store: Store):
    store = any_store
    versions = [f"{i:064x}" for i in range(40)]

    # each with a log of its own, as in processes of their own
    at_once(40, lambda number: MapLog(store, "log").append(PUB, versions[number], needed=_always))
    state = MapLog(store, "log").state()
    assert sorted(state.published) == versions
    assert [entry.seq for entry in state.entries] == list(range(1, 41))
    assert store.list("log") == [f"log/{i:06d}.json" for i in range(1, 41)]


@pytest.mark.parametrize("shared", [False, True])
def test_the_precondition_holds_for_the_very_state_before_the_entry(store: Store, shared: bool):
    logs = [MapLog(store, "log")] * 16 if shared else [MapLog(store, "log") for _ in range(16)]
    entries = at_once(
        16, lambda i: logs[i].append(PUB, f"{i:064x}", needed=lambda state: not state.published)
    )
    assert entries.count(None) == 15
    assert len(MapLog(store, "log").state().entries) == 1


def test_a_lost_reply_is_written_once():
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
def test_an_unreadable_entry_is_passed_over_and_not_overwritten(data: str, caplog: pytest.LogCaptureFixture):
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


# Snapshots: a log that grows without bound is read with bounded calls


class Counts(Store):
    calls: ClassVar[Counter[str]] = Counter()

    def get(self, key: str, *, max_bytes: int | None = None) -> bytes:
        self.calls["get"] += 1
        return super().get(key, max_bytes=max_bytes)

    def scan(self, prefix: str = "", *, after: str | None = None) -> list[StoredObject]:
        found = super().scan(prefix, after=after)
        self.calls["list"] += 1
        self.calls["listed"] += len(found)
        return found

    def put_new(self, key: str, data: bytes | Path) -> bool:
        self.calls["put"] += 1
        return super().put_new(key, data)


def test_after_many_entries_an_append_and_a_cold_read_cost_a_few_calls():
    store = Counts.open("memory://")
    log = MapLog(store, "log")
    log.append(PUB, A, needed=_always)
    log.append(PUB, B, needed=_always)
    for i in range(110 * EVERY):
        log.append(ACT, A if i % 2 else B, needed=_always)

    store.calls.clear()
    log.append(ACT, B, needed=_always)
    assert store.calls["list"] <= 2
    assert store.calls["get"] <= 1
    assert store.calls["put"] <= 2
    assert store.calls["listed"] <= 3 * EVERY

    store.calls.clear()
    state = MapLog(store, "log").state()
    assert (state.last_seq, state.active) == (110 * EVERY + 3, B)
    assert store.calls["get"] <= EVERY + 1
    assert store.calls["list"] == 2
    assert store.calls["listed"] <= EVERY + 111

    store.calls.clear()
    MapLog(store, "log").append(ACT, A, needed=_always)
    assert sum(store.calls[name] for name in ("list", "get", "put")) <= EVERY + 6


@pytest.mark.parametrize("seed", range(12))
def test_a_state_through_snapshots_is_that_of_all_entries(store: Store, seed: int):
    chance = random.Random(seed)
    count, other = chance.randrange(1, 5 * EVERY), random.Random(seed)
    events = [(other.choice(list(Event)), f"{other.randrange(7):064x}") for _ in range(count)]
    log = MapLog(store, "log")
    for event, version in events:
        if chance.random() < 0.02:
            log = MapLog(store, "log")  # another process
        log.append(event, version, needed=_always)
    entries = [json.loads(store.get(key)) for key in store.list("log")]
    assert [(e["event"], e["version"]) for e in entries] == [(e.value, v) for e, v in events]
    parsed = [LogEntry.parse(seq, entry) for seq, entry in enumerate(entries, 1)]
    whole = MapState.of([entry for entry in parsed if entry is not None], len(events))
    assert len(store.list("snapshots")) == len(events) // EVERY
    assert MapLog(store, "log").state() == log.state() == whole
    store.put(f"snapshots/{EVERY:06d}.json", b"")  # damaged: the log is read without it
    assert MapLog(store, "log").state() == whole


@pytest.mark.parametrize("seed", range(6))
def test_a_state_is_the_same_wherever_its_log_was_summed_up(seed: int):
    chance = random.Random(seed)
    entries = [
        LogEntry(seq, chance.choice(list(Event)), f"{chance.randrange(900):064x}", TIME, f"b{seq % 700}")
        for seq in range(1, 2500)
    ]
    whole = MapState.of(entries, len(entries))
    state = MapState()
    begin = 0
    while begin < len(entries):
        some = entries[begin : begin + chance.randrange(1, 400)]
        begin += len(some)
        state = state.after(some, begin)
    assert state == whole
    assert len(whole.entries) <= HISTORY + MARKS + len(whole.published)


def test_writers_and_garbage_collection_do_not_perturb_each_other(any_store: Store):
    store = any_store
    done = threading.Event()

    def write(name: int) -> list[str]:
        log, written = MapLog(store, "log"), []
        for i in range(5 * EVERY):
            entry = log.append(ACT if i else PUB, f"{name:064x}", needed=_always)
            assert entry is not None
            written.append(entry.writer)
        return written

    def collect_until_done() -> int:
        removed, is_last = 0, False
        while not is_last:
            is_last = done.is_set()
            removed += collect(store)
        return removed

    with ThreadPoolExecutor(4) as pool:
        collecting = pool.submit(collect_until_done)
        writers = [pool.submit(write, name) for name in range(2)]
        try:
            written = [writer.result() for writer in writers]
        finally:
            done.set()
        assert collecting.result() > 0
    state = MapLog(store, "log").state()
    assert state.last_seq == 10 * EVERY, "every entry has its own number"
    assert sorted(state.published) == [f"{name:064x}" for name in range(2)]
    assert {entry.writer for entry in state.entries if entry.seq > 5 * EVERY} <= {*written[0], *written[1]}
    assert state.skipped == ()


def test_a_slow_writer_does_not_create_a_removed_number_again():
    """The writer looked, was stopped while the log grew and was collected, and puts its entry only now."""

    class Sleeps(Store):
        asleep = threading.Event()
        wake = threading.Event()

        def put_new(self, key: str, data: bytes | Path) -> bool:
            if threading.current_thread().name.startswith("slow") and not self.asleep.is_set():
                self.asleep.set()
                assert self.wake.wait(60)
            return super().put_new(key, data)

    store = Sleeps.open("memory://")
    assert isinstance(store, Sleeps)
    MapLog(store, "log").append(PUB, A, needed=_always)
    with ThreadPoolExecutor(1, thread_name_prefix="slow") as pool:
        slow = pool.submit(lambda: MapLog(store, "log").append(PUB, B, needed=_always))
        assert store.asleep.wait(60)
        fast = MapLog(store, "log")
        for _ in range(5 * EVERY):
            fast.append(ACT, A, needed=_always)
        collect(store)
        assert "log/000002.json" not in store.list("log")
        store.wake.set()
        entry = slow.result()
    assert entry is not None
    assert entry.seq == 5 * EVERY + 2
    for log in (fast, MapLog(store, "log")):
        assert log.state().published == (A, B), "what was acknowledged counts"
    assert "log/000002.json" not in store.list("log")


def test_a_reader_behind_a_collection_sees_that_the_log_went_on(store: Store):
    sleeper, writer = MapLog(store, "log"), MapLog(store, "log")
    writer.append(PUB, A, needed=_always)
    assert sleeper.state().published == (A,)
    for _ in range(5 * EVERY):
        writer.append(PUB, B, needed=_always)
    collect(store)
    assert "log/000002.json" not in store.list("log")
    assert sleeper.state() == writer.state()


def test_one_damaged_snapshot_loses_nothing_after_a_collection(store: Store):
    log = MapLog(store, "log")
    log.append(PUB, A, needed=_always)
    for _ in range(6 * EVERY):
        log.append(ACT, A, needed=_always)
    collect(store)
    for key in store.list("snapshots"):
        good = store.get(key)
        store.put(key, good[: len(good) // 2])
        assert MapLog(store, "log").state() == log.state(), key
        store.put(key, good)


def test_an_entry_of_a_later_release_is_in_no_snapshot_of_this_one(store: Store):
    log = MapLog(store, "log")
    log.append(PUB, A, needed=_always)
    labelled = {"event": "labelled", "version": A, "time": TIME}
    store.put_new("log/000002.json", record_json(labelled))
    for _ in range(3 * EVERY):
        log.append(ACT, A, needed=_always)
    assert MapLog(store, "log").state().skipped == (2,)
    assert f"snapshots/{EVERY:06d}.json" not in store.list("snapshots")


def test_a_large_number_takes_no_memory(store: Store):
    store.put_new("log/999999999999.json", b"{}")
    state = MapLog(store, "log").state()
    assert state.last_seq == 999_999_999_999
    assert len(state.skipped) <= MAX_SKIPPED
    MapLog(store, "log").append(PUB, A, needed=_always)
    assert MapLog(store, "log").state().published == (A,)


def test_numbers_of_seven_digits_are_listed(store: Store):
    for number in (999_000, 999_999, 1_000_000, 1_000_001):
        store.put_new(f"log/{number:06d}.json", b"{}")
    assert list(scan_after(store, "log", 999_000)) == [999_999, 1_000_000, 1_000_001]
    assert list(scan_after(store, "log", 999_999)) == [1_000_000, 1_000_001]
    assert list(scan_after(store, "log", 1_000_000)) == [1_000_001]
