"""Ages of objects are measured by the store's clock, because this machine's may be wrong."""

from __future__ import annotations

import ast
import importlib
import pkgutil
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import firstfix
from firstfix.builds.callers import CallersKey, claim_build
from firstfix.builds.shared_stages import SharedStages, collect_stages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.recorded_queries import RecordedQueries, new_query_id
from firstfix.catalog.sources import source_key
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.maintenance.garbage import collect_garbage, remove_abandoned
from firstfix.store.store import Store
from tests.core.fixtures import publish

ROOMS = ("builds", "catalog", "store", "maintenance")
WRITES_TIMES_FOR_PEOPLE = ("builds/attempts.py", "catalog/log/map_log.py", "catalog/recorded_queries.py")
HOURS_WRONG = [25, -25]


class WrongClock(datetime):
    """``datetime`` with a wrong ``now``."""

    hours = 0

    @classmethod
    def now(cls, tz: Any = None) -> Any:
        return datetime.now(tz) + timedelta(hours=cls.hours)


def modules_of(package: str) -> Iterator[ModuleType]:
    paths = importlib.import_module(package).__path__
    for found in pkgutil.walk_packages(paths, f"{package}."):
        yield importlib.import_module(found.name)


def uses_datetime(module: ModuleType) -> bool:
    return getattr(module, "datetime", None) is datetime


@pytest.fixture(params=HOURS_WRONG)
def wrong_clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WrongClock, "hours", request.param)
    modules = [module for room in ROOMS for module in modules_of(f"firstfix.{room}") if uses_datetime(module)]
    assert importlib.import_module("firstfix.catalog.recorded_queries") in modules
    for module in modules:
        monkeypatch.setattr(module, "datetime", WrongClock)


def test_a_store_tells_its_time_whatever_this_clock_says(any_store_url: str, wrong_clock: None):
    store = Store.open(any_store_url)
    before = store.now()
    store.put("a", b"x")
    assert before <= store.scan()[0].last_modified <= store.now()
    assert store.list() == ["a"], "the look leaves nothing"
    assert abs(before - datetime.now(timezone.utc)) < timedelta(hours=1)


def test_new_objects_are_young_whatever_this_clock_says(any_store_url, wrong_clock: None, tmp_path):
    store = Store.open(any_store_url)
    catalog = Catalog(store)
    catalog.retire("hall", publish(catalog, tmp_path, "made"), force=True)
    catalog.store.put(f"maps/hall/versions/{'0' * 64}/a.npy", b"of a publish under way")
    store.put(source_key("hall", "0" * 64), b"being handed in")
    Uploads(store).create("u1", size_bytes=3, file_name="x")
    claim_build(store, CallersKey("somebody", "key"), "f", "b1")
    store.put("probe/left", b"first")
    SharedStages(store).put("a" * 64, "mesh", tmp_path / "made")
    recorded_queries = RecordedQueries(store)
    query_id = new_query_id("0" * 8, datetime.now(timezone.utc))
    store.put(f"recorded-queries/{query_id}.body", b"body")
    before = store.list()
    assert collect_garbage(catalog).count == 0
    assert remove_abandoned(catalog).count == 0
    assert store.remove_leftovers() == []
    assert collect_stages(store, 86400.0).removed == ()
    assert recorded_queries.prune(older_than_s=86400.0, max_bytes=1000) == 4
    assert store.list() == before


def test_old_objects_are_collected_whatever_this_clock_says(wrong_clock: None):
    store = Store.open("memory://")
    Uploads(store).create("u1", size_bytes=3, file_name="x")
    store.put(f"recorded-queries/{new_query_id('0' * 8, datetime.now(timezone.utc))}.body", b"body")
    assert remove_abandoned(Catalog(store), older_than_s=-5).count == 1
    assert RecordedQueries(store).prune(older_than_s=-5, max_bytes=1000) == 0
    assert store.list() == []


def test_a_retirement_is_as_old_as_the_store_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store = Store.open("memory://")
    catalog = Catalog(store)
    version = publish(catalog, tmp_path, "made")
    with monkeypatch.context() as patch:  # the clock of whoever retires it is a year behind
        patch.setattr(WrongClock, "hours", -365 * 24)
        patch.setattr(importlib.import_module("firstfix.catalog.log.map_log"), "datetime", WrongClock)
        catalog.retire("hall", version, force=True)
    old = {item.key: item.last_modified for item in store.scan("maps/hall/versions")}
    assert old
    monkeypatch.setattr(store, "scan", lambda *where, scan=store.scan, **how: _aged(scan(*where, **how), old))
    assert catalog.collect_garbage("hall") == [], "a replica may still serve it"


def _aged(found: list[Any], old: dict[str, datetime]) -> list[Any]:
    """Objects of a listing, with some of them made two days older."""
    two_days = timedelta(days=2)
    return [
        type(item)(item.key, item.size_bytes, item.last_modified - two_days * (item.key in old))
        for item in found
    ]


def test_nothing_compares_a_stores_time_with_this_clock():
    root = Path(firstfix.__file__).parent
    found = set()
    for path in root.rglob("*.py"):
        attributes = {
            f"{node.value.id}.{node.attr}" if isinstance(node.value, ast.Name) else f".{node.attr}"
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Attribute)
        }
        reads_ages = any(name.endswith(".last_modified") for name in attributes)
        if reads_ages and attributes & {"datetime.now", "time.time"}:
            found.add(path.relative_to(root).as_posix())
    assert found == set(WRITES_TIMES_FOR_PEOPLE), "the others use Store.now"
