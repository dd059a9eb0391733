"""Periodic verification of the store: its metrics, its rate, and when it does not run."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_service.maintenance import verification
from firstfix_service.maintenance.verification import CALL_BYTES, verify_once
from firstfix_service.settings import Settings
from firstfix_service.telemetry.metrics import Metrics
from tests.service.service_world import publish, running_service
from tests.waiting import wait_until


@pytest.fixture
def catalog(tmp_path: Path) -> Catalog:
    catalog = Catalog(Store.open("memory://"))
    publish(catalog, "hall", "1", tmp_path / "scratch")
    return catalog


def verified(
    catalog: Catalog, monkeypatch: pytest.MonkeyPatch, **settings: object
) -> tuple[Metrics, list[float]]:
    pauses: list[float] = []

    async def sleep(seconds: float) -> None:
        pauses.append(seconds)

    metrics = Metrics()
    with monkeypatch.context() as patch:
        patch.setattr(verification.asyncio, "sleep", sleep)
        asyncio.run(verify_once(Settings(store="memory://", **settings), catalog.store, metrics))
    return metrics, pauses


def counted(metrics: Metrics, name: str, **labels: str) -> float:
    found = metrics.registry.get_sample_value(name, labels)
    assert found is not None
    return found


def test_right_and_damaged_objects_are_counted(catalog: Catalog, monkeypatch: pytest.MonkeyPatch):
    metrics, _ = verified(catalog, monkeypatch)
    right = counted(metrics, "firstfix_verified_objects_total", result="right")
    assert right >= 5
    assert counted(metrics, "firstfix_verified_objects_total", result="damaged") == 0
    assert counted(metrics, "firstfix_damaged_objects") == 0
    assert counted(metrics, "firstfix_verify_bytes_total") > 0
    assert counted(metrics, "firstfix_verify_seconds_total") > 0

    (first, *_) = (o for o in catalog.store.scan("maps/hall/versions") if not o.key.endswith("manifest.json"))
    catalog.store.put(first.key, b"x" * first.size_bytes)
    catalog.store.put("changes/00000001.json", b"")
    metrics, _ = verified(catalog, monkeypatch)
    assert counted(metrics, "firstfix_verified_objects_total", result="damaged") == 2
    assert counted(metrics, "firstfix_damaged_objects") == 2
    assert catalog.store.get("changes/00000001.json") == b"", "verification repairs nothing"


def test_it_reads_no_faster_than_it_may(catalog: Catalog, monkeypatch: pytest.MonkeyPatch):
    rate = 1 << 20
    metrics, pauses = verified(catalog, monkeypatch, verify_bytes_per_s=rate)
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
