"""Tasks of the service: the comparison of clocks, patches that are due, and the verification of the store."""

from __future__ import annotations

import asyncio
from datetime import datetime, timedelta, timezone
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sightings.sightings import MERGE_FROM, Sightings
from firstfix.catalog.sources import put_source, source_key
from firstfix.engine.changes.cells import keys_of
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import Tally
from firstfix.maintenance.patch import hour_of
from firstfix.store.store import Store
from firstfix_service.maintenance import clock, verification
from firstfix_service.maintenance.clock import ClockComparison
from firstfix_service.maintenance.patches import map_patches
from firstfix_service.maintenance.verification import CALL_BYTES, verify_once
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.query_workers.sightings import keeper as sightings
from firstfix_service.query_workers.sightings.counter import Sighted
from firstfix_service.query_workers.sightings.keeper import SightingsKeeper
from firstfix_service.settings import Settings
from firstfix_service.telemetry.metrics import Metrics
from tests.service.service_world import publish, running_service
from tests.waiting import wait_until

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


def test_the_offset_of_the_clock_is_measured_and_logged_once():
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


def test_a_slow_store_is_not_taken_for_a_wrong_clock(monkeypatch: pytest.MonkeyPatch):
    metrics, now_s = Metrics(), 100.0
    monkeypatch.setattr(clock, "time", SimpleNamespace(time=lambda: now_s))

    class Slow:
        def now(self) -> datetime:
            nonlocal now_s
            now_s = 190.0
            return datetime.fromtimestamp(140.0, timezone.utc)

    ClockComparison(Slow(), metrics).compare()  # type: ignore[arg-type]
    assert metrics.registry.get_sample_value("firstfix_clock_offset_seconds") == 0.0


HOUR = datetime(2026, 3, 4, hour_of("hall"), 5, tzinfo=timezone.utc)
PLACE = np.sort(keys_of(np.array([[x, 4, 2] for x in range(4)])))
NOTHING = np.empty(0, np.int64)


def changed_map(catalog: Catalog, folder: Path) -> None:
    """Publishes a map that allows patches, and three days of queries that have seen a change."""
    (folder / "a.npy").write_bytes(b"1")
    key = source_key("hall", put_source(catalog.store, "hall", folder / "a.npy"))
    request = {"map_id": "hall", "source": {"key": key}, "file_name": "a.npy", "trajectory": None}
    catalog.builds.put("b1", {**request, "config": {"patch": "propose"}})
    version = catalog.publish("hall", folder, Manifest.for_directory(folder), build_id="b1")
    for day in range(3):
        spots = [Sighting((7 * n, day, 1), NOTHING, PLACE, NOTHING, NOTHING) for n in range(9)]
        tally = Tally.sum([Tally.of(spot) for spot in spots])
        Sightings(catalog.store).put(catalog.folder_of("hall", version), tally, HOUR - timedelta(days=day))


@pytest.mark.parametrize("has_queue", [True, False])
def test_due_patches_are_recorded_once_and_handed_to_the_queue(tmp_path, monkeypatch, has_queue):
    catalog = Catalog(Store.open("memory://"))
    changed_map(catalog, tmp_path)
    monkeypatch.setattr(Store, "now", lambda self: HOUR)
    submitted: list[str] = []

    async def submit(build_id: str) -> None:
        submitted.append(build_id)

    task = map_patches(catalog, submit if has_queue else None)
    for _ in range(2):
        asyncio.run(task.work())  # type: ignore[arg-type]
    recorded = [build_id for build_id in catalog.builds.ids() if build_id != "b1"]
    assert len(recorded) == 1
    assert submitted == (recorded if has_queue else [])


@pytest.fixture
def published(tmp_path: Path) -> Catalog:
    published = Catalog(Store.open("memory://"))
    publish(published, "hall", "1", tmp_path / "scratch")
    return published


def verified(
    published: Catalog, monkeypatch: pytest.MonkeyPatch, **settings: object
) -> tuple[Metrics, list[float]]:
    pauses: list[float] = []

    async def sleep(seconds: float) -> None:
        pauses.append(seconds)

    metrics = Metrics()
    with monkeypatch.context() as patch:
        patch.setattr(verification.asyncio, "sleep", sleep)
        asyncio.run(verify_once(Settings(store="memory://", **settings), published.store, metrics))
    return metrics, pauses


def counted(metrics: Metrics, name: str, **labels: str) -> float:
    found = metrics.registry.get_sample_value(name, labels)
    assert found is not None
    return found


def test_intact_and_damaged_objects_are_counted(published: Catalog, monkeypatch: pytest.MonkeyPatch):
    metrics, _ = verified(published, monkeypatch)
    right = counted(metrics, "firstfix_verified_objects_total", result="right")
    assert right >= 5
    assert counted(metrics, "firstfix_verified_objects_total", result="damaged") == 0
    assert counted(metrics, "firstfix_damaged_objects") == 0
    assert counted(metrics, "firstfix_verify_bytes_total") > 0
    assert counted(metrics, "firstfix_verify_seconds_total") > 0

    (first, *_) = (
        o for o in published.store.scan("maps/hall/versions") if not o.key.endswith("manifest.json")
    )
    published.store.put(first.key, b"x" * first.size_bytes)
    published.store.put("changes/00000001.json", b"")
    metrics, _ = verified(published, monkeypatch)
    assert counted(metrics, "firstfix_verified_objects_total", result="damaged") == 2
    assert counted(metrics, "firstfix_damaged_objects") == 2
    assert published.store.get("changes/00000001.json") == b"", "verification repairs nothing"


def test_verification_keeps_to_its_rate(published: Catalog, monkeypatch: pytest.MonkeyPatch):
    rate = 1 << 20
    metrics, pauses = verified(published, monkeypatch, verify_bytes_per_s=rate)
    assert sum(pauses) >= counted(metrics, "firstfix_verify_bytes_total") / rate
    assert min(pauses) >= CALL_BYTES / rate, "small objects count too"


@pytest.mark.parametrize("settings", [{}, {"verify_bytes_per_s": 0}, {"read_only": True}])
def test_a_service_verifies_the_store_if_it_may_write(tmp_path, monkeypatch, settings):
    monkeypatch.setattr(verification, "FIRST_AFTER_S", 0.0)
    begun: list[Settings] = []

    async def begin(settings: Settings, store: Store, metrics: Metrics) -> None:
        begun.append(settings)
        raise RuntimeError("a defect is logged, and the service goes on")

    monkeypatch.setattr(verification, "verify_once", begin)
    Store.open(str(tmp_path / "store"))
    with running_service(tmp_path, zenoh=False, **settings) as service:
        if not settings:
            wait_until(lambda: bool(begun))
        assert service.http.get("/healthz").is_success
    assert bool(begun) == (not settings)
