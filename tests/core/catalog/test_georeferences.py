from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from firstfix.catalog.geopose import Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.errors import InvalidOption, StoreError
from firstfix.store.store import Store


def at(latitude_deg: float) -> Georeference:
    return Georeference.with_heading(latitude_deg, 8.0, 100.0, 0.0)


def test_the_last_one_counts(any_store_url: str):
    georeferences = Georeferences(Store.open(any_store_url))
    assert georeferences.get("hall") is None
    georeferences.set("hall", at(1))
    georeferences.set("hall", at(2))
    assert georeferences.get("hall") == at(2)
    assert georeferences.get("attic") is None
    georeferences.set("hall", None)
    assert georeferences.get("hall") is None
    georeferences.set("hall", at(3))
    assert georeferences.get("hall") == at(3)


def test_none_is_lost_in_a_race(any_store_url: str):
    store = Store.open(any_store_url)
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda n: Georeferences(store).set("hall", at(n)), range(16)))
    assert len(store.list("maps/hall/georeference")) == 16


def test_a_record_that_cannot_be_read_is_no_place():
    store = Store.open("memory://")
    georeferences = Georeferences(store)
    georeferences.set("hall", at(1))
    store.put("maps/hall/georeference/000002.json", b'{"latitude_deg": 1}')
    with pytest.raises(StoreError, match="000002"):
        georeferences.get("hall")
    with pytest.raises(InvalidOption):
        georeferences.get("../x")
