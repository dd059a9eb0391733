"""Callers of builds: what they use, and the keys by which a request is repeated."""

from __future__ import annotations

from datetime import timedelta

import pytest

from firstfix.builds.callers import (
    CALLERS_FOLDER,
    IDEMPOTENCY_FOLDER,
    CallersKey,
    CallerUsage,
    claim_build,
    claimed_build,
)
from firstfix.builds.records import BuildRecords, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.errors import IdempotencyConflict
from firstfix.maintenance.garbage import USAGE_DAYS, collect_garbage, remove_abandoned
from firstfix.store.store import Store
from tests.core.fixtures import at_once


def catalog_with(*build_ids: str, url: str = "memory://") -> Catalog:
    catalog = Catalog(Store.open(url))
    for build_id in build_ids:
        CallerUsage(catalog.builds).begin("key:a", build_id)
        catalog.builds.put(build_id, {"map_id": "hall", "owner": "key:a"})
    return catalog


def test_builds_count_until_they_have_ended(any_store_url: str):
    catalog = catalog_with("b1", "b2", url=any_store_url)
    usage = CallerUsage(catalog.builds)
    usage.begin("key:a", "b2")
    usage.begin("key:a", "never-recorded")
    assert usage.unfinished("key:a") == {"b1", "b2"}
    assert usage.unfinished("key:b") == set()
    catalog.builds.set_status("b1", new_status("failed", map_id="hall"))
    assert usage.unfinished("key:a") == {"b2"}
    entries = {key.rsplit("/", 1)[-1] for key in catalog.store.list(CALLERS_FOLDER)}
    assert entries == {"b2", "never-recorded"}, "what has ended is not looked at again"


def test_minutes_add_up_over_builds_and_attempts(any_store_url: str):
    usage = CallerUsage(BuildRecords(Store.open(any_store_url)))
    usage.charge("key:a", "b1", 1, 90.4)
    usage.charge("key:a", "b1", 1, 90.4)
    usage.charge("key:a", "b1", 2, 30.0)
    usage.charge("key:a", "b2", 1, -5.0)
    usage.charge("key:b", "b3", 1, 6000.0)
    assert usage.minutes_today("key:a") == 2.0


def test_an_invalid_name_of_a_run_counts_nothing(catalog: Catalog):
    usage = CallerUsage(catalog.builds)
    usage.charge("key:a", "b1", 1, 60.0)
    (key,) = catalog.store.list(CALLERS_FOLDER)
    for name in ("b1", "b1.1", "b1.1.x", f"b1.1.{'9' * 100}", "b1.1.60.60"):
        catalog.store.put_new(f"{key.rsplit('/', 1)[0]}/{name}", b"")
    assert usage.minutes_today("key:a") == 1.0


def test_old_entries_are_garbage(monkeypatch: pytest.MonkeyPatch):
    catalog = catalog_with("b1")
    CallerUsage(catalog.builds).charge("key:a", "b1", 1, 60.0)
    assert remove_abandoned(catalog).keys[CALLERS_FOLDER] == []
    now = catalog.store.now()
    for days, left in ((USAGE_DAYS - 1, 2), (USAGE_DAYS + 1, 0)):
        later = now + timedelta(days=days)
        monkeypatch.setattr(catalog.store, "now", lambda later=later: later)
        dry = collect_garbage(catalog, dry_run=True).keys[CALLERS_FOLDER]
        assert remove_abandoned(catalog).keys[CALLERS_FOLDER] == dry
        assert len(catalog.store.list(CALLERS_FOLDER)) == left


NIGHT_1, NIGHT_2 = CallersKey("key:a", "night/1"), CallersKey("key:a", "night/2")


def test_the_first_build_of_a_key_stays(any_store: Store):
    store = any_store
    assert claim_build(store, NIGHT_1, "same", "b1") == "b1"
    assert claim_build(store, NIGHT_1, "same", "b2") == "b1"
    assert claim_build(store, NIGHT_2, "same", "b3") == "b3"
    with pytest.raises(IdempotencyConflict):
        claim_build(store, NIGHT_1, "other", "b4")
    assert len(store.list(IDEMPOTENCY_FOLDER)) == 2


def test_many_claims_at_once_give_one_build(any_store: Store):
    store = any_store
    assert len(set(at_once(16, lambda n: claim_build(store, NIGHT_1, "same", f"b{n}")))) == 1


def test_a_key_is_its_callers_own(store: Store):
    theirs = CallersKey("key:b", "night/1")
    assert claim_build(store, NIGHT_1, "same", "b1") == "b1"
    assert (claimed_build(store, NIGHT_1), claimed_build(store, theirs)) == ("b1", None)
    assert claim_build(store, theirs, "other", "b2") == "b2", "neither their build nor a conflict"


def test_no_two_callers_share_a_name():
    pairs = (("a", "bc"), ("ab", "c"), ("a,", "b"), ("a", ",b"))
    assert len({CallersKey(caller, key).name for caller, key in pairs}) == len(pairs)
