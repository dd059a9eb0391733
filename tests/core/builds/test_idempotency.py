from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from firstfix.builds.callers import IDEMPOTENCY_FOLDER, CallersKey, claim_build, claimed_build
from firstfix.errors import IdempotencyConflict
from firstfix.store.store import Store

NIGHT_1, NIGHT_2 = CallersKey("key:a", "night/1"), CallersKey("key:a", "night/2")


def test_the_first_build_of_a_key_stays(any_store_url: str):
    store = Store.open(any_store_url)
    assert claim_build(store, NIGHT_1, "same", "b1") == "b1"
    assert claim_build(store, NIGHT_1, "same", "b2") == "b1"
    assert claim_build(store, NIGHT_2, "same", "b3") == "b3"
    with pytest.raises(IdempotencyConflict):
        claim_build(store, NIGHT_1, "other", "b4")
    assert len(store.list(IDEMPOTENCY_FOLDER)) == 2


def test_of_many_at_once_one_build_comes_out(any_store_url: str):
    store = Store.open(any_store_url)
    with ThreadPoolExecutor(8) as threads:
        found = set(threads.map(lambda n: claim_build(store, NIGHT_1, "same", f"b{n}"), range(16)))
    assert len(found) == 1


def test_a_key_is_its_callers_own():
    store = Store.open("memory://")
    theirs = CallersKey("key:b", "night/1")
    assert claim_build(store, NIGHT_1, "same", "b1") == "b1"
    assert (claimed_build(store, NIGHT_1), claimed_build(store, theirs)) == ("b1", None)
    assert claim_build(store, theirs, "other", "b2") == "b2", "neither their build nor a conflict"


def test_no_two_callers_share_a_name():
    pairs = (("a", "bc"), ("ab", "c"), ("a,", "b"), ("a", ",b"))
    assert len({CallersKey(caller, key).name for caller, key in pairs}) == len(pairs)
