"""A wrong local clock: it is told, and it decides nothing about what others have stored."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.sightings.sightings import MERGE_FROM, Sightings
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import Tally
from firstfix.store.store import Store
from firstfix_service.maintenance import clock
from firstfix_service.maintenance.clock import ClockComparison
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.query_workers.sightings import keeper as sightings
from firstfix_service.query_workers.sightings.counter import Sighted
from firstfix_service.query_workers.sightings.keeper import SightingsKeeper
from firstfix_service.telemetry.metrics import Metrics
from tests.service.service_world import publish

AHEAD = timedelta(days=40)
COUNTED = Tally.of(Sighting((1, 2, 3), *([[1, 2], [], [1], []])))  # type: ignore[arg-type]


class _Ahead(datetime):
    """A local clock that is 40 days ahead."""

    @classmethod
    def now(cls, tz: Any = None) -> datetime:
        return datetime.now(tz) + AHEAD


class _Workers:
    """Query workers that have counted one sighting."""

    def __init__(self, served: ServedVersion) -> None:
        self._served = served

    def take_sightings(self) -> list[Sighted]:
        return [Sighted({self._served: COUNTED}, {})]


def test_a_replica_whose_clock_is_ahead_removes_no_sightings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    catalog = Catalog(Store.open("memory://"))
    version = publish(catalog, "hall", "1", tmp_path)
    folder = catalog.folder_of("hall", version)
    now = catalog.store.now()
    for number in range(MERGE_FROM):
        Sightings(catalog.store).put(folder, COUNTED, now + timedelta(microseconds=number))
    monkeypatch.setattr(sightings, "datetime", _Ahead)
    kept = SightingsKeeper(catalog, _Workers(ServedVersion("hall", version, tmp_path)), Metrics())  # type: ignore[arg-type]
    kept.flush()
    found = Sightings(catalog.store).read(folder)
    assert sum(day.tally.sightings for day in found.days.values()) == MERGE_FROM + 1
    assert max(found.days) <= (catalog.store.now() + timedelta(days=1)).date().isoformat()
    assert catalog.store.list(f"{folder.key}/sightings/merged"), "they were merged"


class _Store:
    """A store whose clock can be set."""

    offset_s = 0.0

    def now(self) -> datetime:
        return datetime.now(timezone.utc) - timedelta(seconds=self.offset_s)


def test_the_offset_of_the_clock_is_measured_and_told_once():
    store, metrics = _Store(), Metrics()
    comparison = ClockComparison(store, metrics)  # type: ignore[arg-type]
    warnings = []
    for store.offset_s in (0.0, 20.0, 3600.0, 3605.0, 7200.0, 1.0, -45.0):
        with structlog.testing.capture_logs() as logs:
            comparison.compare()
        measured = metrics.registry.get_sample_value("firstfix_clock_offset_seconds")
        assert measured == pytest.approx(store.offset_s, abs=10)
        warnings.append([entry["log_level"] for entry in logs])
    assert warnings == [[], [], ["warning"], [], ["warning"], ["info"], ["warning"]]


def test_a_slow_store_is_no_wrong_clock(monkeypatch: pytest.MonkeyPatch):
    metrics, now_s = Metrics(), 100.0
    monkeypatch.setattr(clock, "time", SimpleNamespace(time=lambda: now_s))

    class Slow:
        def now(self) -> datetime:
            nonlocal now_s
            now_s = 190.0
            return datetime.fromtimestamp(140.0, timezone.utc)

    ClockComparison(Slow(), metrics).compare()  # type: ignore[arg-type]
    assert metrics.registry.get_sample_value("firstfix_clock_offset_seconds") == 0.0
