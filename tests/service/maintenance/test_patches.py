"""The task that records the patches that are due, and hands them to the build queue."""

from __future__ import annotations

import asyncio
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sightings.sightings import Sightings
from firstfix.catalog.sources import put_source, source_key
from firstfix.engine.changes.cells import keys_of
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import Tally
from firstfix.maintenance.patch import hour_of
from firstfix.store.store import Store
from firstfix_service.maintenance.patches import map_patches

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
def test_due_patches_are_recorded_once_and_handed_to_the_queue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_queue: bool
):
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
