"""Notices of changes: numbered without gaps, found with few calls, and only hints."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import pytest

from firstfix.catalog.log.change_log import MARK_EVERY, ChangeLog
from firstfix.catalog.log.log_garbage import change_garbage
from firstfix.store.store import Store
from tests.core.fixtures import at_once, recording


def test_notices_are_read_in_order_and_each_map_once(any_store: Store):
    store = any_store
    log, reader = ChangeLog(store), ChangeLog(store)
    assert reader.since(0) == ([], 0)
    for map_id in ("b", "a", "b"):
        log.note(map_id)
    assert reader.end() == 3
    assert reader.since(0) == (["b", "a"], 3)
    assert reader.since(3) == ([], 3)
    ChangeLog(store).note("c")
    assert reader.since(3) == (["c"], 4)


def test_racing_writers_leave_no_gap(any_store: Store):
    store = any_store
    at_once(18, lambda k: ChangeLog(store).note(f"map-{k}"))
    names, last = ChangeLog(store).since(0)
    assert last == 18
    assert sorted(names) == sorted(f"map-{k}" for k in range(18))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 8, 100])
def test_the_end_is_found_with_few_calls(count: int):
    store, calls = recording("memory://", "get", "exists")
    writer = ChangeLog(store)
    for _ in range(count):
        writer.note("hall")
    del calls[:]
    reader = ChangeLog(store)
    assert reader.end() == count
    assert len(calls) <= 16
    del calls[:]
    assert reader.since(count) == ([], count)
    assert len(calls) == 1, "nothing new costs one call"


def test_an_unreadable_notice_is_passed_over(store: Store):
    log = ChangeLog(store)
    log.note("a")
    store.put_new("changes/00000002.json", b"\xff no notice")
    store.put_new("changes/00000003.json", b'{"map_id": "../../etc"}')
    store.put_new("changes/00000004.json", b"[]")
    log.note("b")
    assert ChangeLog(store).since(0) == (["a", "b"], 5)


def test_removed_notices_do_not_mislead_a_writer(store: Store):
    log = ChangeLog(store)
    for name in ("a", "b", "c"):
        log.note(name)
    for key in store.list("changes"):
        store.delete(key)
    assert log.end() == 0
    log.note("d")
    assert ChangeLog(store).since(0) == (["d"], 1)


def collect(store: Store) -> list[str]:
    """Collect garbage as if a day had passed."""
    found = change_garbage(store, datetime.now(timezone.utc) + timedelta(days=1))
    for key in found:
        store.delete(key)
    return found


def test_old_notices_are_collected_and_mislead_nobody():
    store, calls = recording("memory://", "get", "exists")
    writer = ChangeLog(store)
    for k in range(2 * MARK_EVERY + 50):
        writer.note(f"map-{k}")
    assert len(collect(store)) == MARK_EVERY
    assert collect(store) == []
    del calls[:]
    reader = ChangeLog(store)
    assert reader.end() == writer.end() == 2 * MARK_EVERY + 50
    assert len(calls) <= 30, "from the last mark on, however many there are"
    writer.note("newest")
    assert reader.since(2 * MARK_EVERY + 50) == (["newest"], 2 * MARK_EVERY + 51)
    assert ChangeLog(store).end() == 2 * MARK_EVERY + 51


def test_a_reader_whose_notices_were_collected_goes_on_at_the_end(store: Store):
    writer, reader = ChangeLog(store), ChangeLog(store)
    writer.note("a")
    position = reader.end()
    assert reader.go_on_from(position) == position
    for _ in range(3 * MARK_EVERY):
        writer.note("b")
    assert reader.go_on_from(position) == position, "they are all still there to be read"
    collect(store)
    assert reader.since(position) == ([], position)
    assert reader.go_on_from(position) == writer.end()


def test_a_reader_far_behind_reads_a_bounded_part_at_a_time():
    store, calls = recording("memory://", "get", "exists")
    writer = ChangeLog(store)
    for k in range(1500):
        writer.note(f"map-{k}")
    del calls[:]
    names, position = ChangeLog(store).since(0)
    assert 1000 <= position < 1100
    assert len(names) == position
    assert len(calls) < 1100
    rest, end = ChangeLog(store).since(position)
    assert (len(rest), end) == (1500 - position, 1500)
