from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from firstfix.errors import IdempotencyConflict
from firstfix.idempotency import FOLDER, claim_build
from firstfix.store import Store


def test_the_first_build_of_a_key_stays(any_store_url: str):
    store = Store.open(any_store_url)
    assert claim_build(store, "night/1", "same", "b1") == "b1"
    assert claim_build(store, "night/1", "same", "b2") == "b1"
    assert claim_build(store, "night/2", "same", "b3") == "b3"
    with pytest.raises(IdempotencyConflict):
        claim_build(store, "night/1", "other", "b4")
    assert len(store.list(FOLDER)) == 2


def test_of_many_at_once_one_build_comes_out(any_store_url: str):
    store = Store.open(any_store_url)
    with ThreadPoolExecutor(8) as threads:
        found = set(threads.map(lambda n: claim_build(store, "k", "same", f"b{n}"), range(16)))
    assert len(found) == 1
