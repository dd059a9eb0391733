"""Sightings in the store: parts of several replicas, merging, damage, retirement."""

from __future__ import annotations

import base64
import json
import zlib
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.sightings.changes import changes_of
from firstfix.catalog.sightings.record import Day, SightingsRecord
from firstfix.catalog.sightings.sightings import KEPT_DAYS, MERGE_FROM, Sightings
from firstfix.catalog.versions.objects import VersionFolder
from firstfix.engine.changes.cells import keys_of
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import Tally
from firstfix.errors import NotFound
from firstfix.maintenance.backup import copy_store
from firstfix.maintenance.garbage import Ages, collect_garbage
from firstfix.maintenance.repair import Repair
from firstfix.maintenance.verify import Verification
from firstfix.store.store import Store
from tests.core.fixtures import publish

NOW = datetime(2026, 3, 4, 12, tzinfo=timezone.utc)
PLACE = np.sort(keys_of(np.array([[x, 4, 2] for x in range(4)])))
NOTHING = np.empty(0, np.int64)


def tally(*spots: int) -> Tally:
    return Tally.sum([Tally.of(Sighting((7 * n, 0, 1), NOTHING, PLACE, NOTHING, NOTHING)) for n in spots])


def total(record: SightingsRecord) -> int:
    return sum(day.tally.sightings for day in record.days.values())


@pytest.fixture
def folder(catalog: Catalog, tmp_path: Path) -> VersionFolder:
    return catalog.folder_of("hall", publish(catalog, tmp_path, "1"))


def put_parts(sightings: Sightings, folder: VersionFolder, begin: datetime = NOW) -> None:
    """So many parts that they are merged."""
    for number in range(MERGE_FROM):
        sightings.put(folder, tally(number), begin + timedelta(seconds=number))


def objects(catalog: Catalog, folder: VersionFolder) -> list[str]:
    return [
        key.removeprefix(f"{folder.key}/sightings/") for key in catalog.store.list(f"{folder.key}/sightings")
    ]


def test_parts_of_all_replicas_add_up(catalog: Catalog, folder: VersionFolder):
    assert changes_of(Sightings(catalog.store).read(folder))["areas"] == []
    for replica in range(3):  # none of them has enough alone
        Sightings(catalog.store).put(folder, tally(*range(3 * replica, 3 * replica + 3)), NOW)
    found = changes_of(Sightings(catalog.store).read(folder), with_cells=True, with_grid=True)
    (area,) = found["areas"]
    assert (area["kind"], area["cells"], area["sightings"], area["against"]) == ("gone", 4, 9, 0)
    assert area["box"] == {"low": [0.0, 2.0, 1.0], "high": [2.0, 2.5, 1.5]}
    assert area["cell_list"] == [[x, 4, 2] for x in range(4)]
    assert area["first_seen"] == area["last_seen"] == NOW.isoformat()
    assert found["grid"]["contradicted"] == [9] * 4
    assert (found["sightings"], found["seen_cells"], found["areas_found"]) == (9, 4, 1)


def test_a_record_is_read_from_its_json():
    record = SightingsRecord(
        {"2026-03-04": Day(tally(1, 2, 3), NOW.isoformat(), NOW.isoformat())}, ("a.json",)
    )
    there = SightingsRecord.parse(json.loads(record.to_json()))
    assert there.parts == ("a.json",)
    for name in ("cell", "slot", "counts"):
        same = getattr(there.days["2026-03-04"].tally, name)
        assert np.array_equal(same, getattr(tally(1, 2, 3), name))
    written = SightingsRecord.of(hole(1, 2), NOW)
    assert json.loads(SightingsRecord.parse(json.loads(written.to_json())).to_json()) == json.loads(
        written.to_json()
    )


def hole(*spots: int) -> Tally:
    """Of a map that knows what its mapping run saw: PLACE was never seen."""
    told = (Sighting((7 * n, 0, 1), NOTHING, NOTHING, PLACE, NOTHING, PLACE, True) for n in spots)
    return Tally.sum(map(Tally.of, told))


def test_unmapped_places_are_told_from_changed_ones(catalog: Catalog, folder: VersionFolder):
    Sightings(catalog.store).put(folder, hole(*range(9)), NOW)
    found = changes_of(Sightings(catalog.store).read(folder), with_grid=True)
    assert [area["kind"] for area in found["areas"]] == ["unmapped"]
    assert found["areas"][0]["first_seen"] == NOW.isoformat()
    assert (found["sightings"], found["coverage_known"]) == (9, 9)
    assert found["grid"]["unmapped"] == found["grid"]["unexplained"] == [9] * 4


def test_many_parts_are_merged_and_count_once(catalog: Catalog, folder: VersionFolder):
    sightings = Sightings(catalog.store)
    for number in range(MERGE_FROM):
        assert not sightings.merge(folder, NOW)
        sightings.put(folder, tally(number), NOW + timedelta(seconds=number))
    assert sightings.merge(folder, NOW)
    assert objects(catalog, folder) == ["merged/000001.json"]
    assert total(sightings.read(folder)) == MERGE_FROM
    sightings.put(folder, tally(1), NOW)
    assert total(sightings.read(folder)) == MERGE_FROM + 1


def test_a_merge_that_was_killed_counts_nothing_twice(catalog, folder, monkeypatch):
    sightings = Sightings(catalog.store)
    put_parts(sightings, folder)
    with monkeypatch.context() as patch:
        patch.setattr(Store, "delete", lambda self, key: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            sightings.merge(folder, NOW)
    assert len(objects(catalog, folder)) == MERGE_FROM + 1
    assert total(sightings.read(folder)) == MERGE_FROM
    put_parts(sightings, folder, NOW + timedelta(seconds=100))
    assert sightings.merge(folder, NOW)
    assert total(sightings.read(folder)) == 2 * MERGE_FROM
    assert objects(catalog, folder) == ["merged/000002.json"], "the parts that were left are gone too"


def test_one_of_two_simultaneous_merges_wins(catalog, folder, monkeypatch):
    one, other = Sightings(catalog.store), Sightings(catalog.store)
    put_parts(one, folder)
    put_new, raced = Store.put_new, []

    def race(self: Store, key: str, data: bytes | Path) -> bool:
        if not raced:
            raced.append(key)
            assert other.merge(folder, NOW)
        return put_new(self, key, data)

    monkeypatch.setattr(Store, "put_new", race)
    assert not one.merge(folder, NOW)
    assert total(one.read(folder)) == MERGE_FROM


def test_old_days_are_dropped(catalog: Catalog, folder: VersionFolder):
    sightings = Sightings(catalog.store)
    sightings.put(folder, tally(1), NOW - timedelta(days=KEPT_DAYS + 1))
    put_parts(sightings, folder)
    assert sightings.merge(folder, NOW)
    assert list(sightings.read(folder).days) == [NOW.date().isoformat()]


@pytest.mark.parametrize("damage", [b"", b"{}", b"[1]", b'{"format": 1, "days": 5}', bytes(100)])
def test_a_damaged_part_costs_itself_alone(catalog: Catalog, folder: VersionFolder, damage: bytes):
    sightings = Sightings(catalog.store)
    sightings.put(folder, tally(1, 2), NOW)
    sightings.put(folder, tally(3), NOW + timedelta(seconds=1))
    first = catalog.store.list(f"{folder.key}/sightings")[0]
    catalog.store.put(first, damage)
    assert total(sightings.read(folder)) == 1
    (finding,) = Verification(catalog.store).run().findings
    assert (finding.key, "sightings" in finding.problem) == (first, True)
    assert Verification(catalog.store, repair=Repair(catalog.store)).run().damaged == []
    assert Verification(catalog.store).run().findings == []


@pytest.mark.parametrize(
    "damage",
    [
        *({"rows": rows} for rows in (0, 7, 9, 10**9, -1, 2.0, None)),
        {"coverage_known": -1},
        {"coverage_known": 3},
        {"coverage_known": None},
        {"coverage_known": 1.0},
        {"columns": base64.b64encode(zlib.compress(bytes(7))).decode()},
    ],
)
def test_a_record_that_contradicts_itself_is_refused(damage: dict[str, Any]):
    good = json.loads(SightingsRecord.of(hole(1, 2), NOW).to_json())
    (day,) = good["days"].values()
    assert SightingsRecord.parse(good).days
    day.update(damage)
    with pytest.raises((ValueError, TypeError)):
        SightingsRecord.parse(good)


def test_a_damaged_sum_does_not_end_counting(catalog: Catalog, folder: VersionFolder):
    sightings = Sightings(catalog.store)
    catalog.store.put(f"{folder.key}/sightings/merged/000004.json", b"broken")
    put_parts(sightings, folder)
    assert total(sightings.read(folder)) == MERGE_FROM
    assert sightings.merge(folder, NOW)
    assert objects(catalog, folder) == ["merged/000005.json"]


def test_a_retired_version_takes_its_sightings_along(catalog: Catalog, folder: VersionFolder):
    Sightings(catalog.store).put(folder, tally(1), NOW)
    catalog.retire("hall", folder.version, force=True)
    with pytest.raises(NotFound):
        catalog.folder_of("hall", folder.version)
    Sightings(catalog.store).put(folder, tally(2), NOW)  # by a replica that has not heard of it
    removed = collect_garbage(catalog, ages=Ages(things_s=-60.0, logs_s=0.0)).keys["versions"]
    assert sum("/sightings/" in key for key in removed) == 2
    assert catalog.store.list(f"{folder.key}") == []


def test_a_copy_of_the_store_has_no_sightings(catalog: Catalog, folder: VersionFolder, tmp_path: Path):
    Sightings(catalog.store).put(folder, tally(1), NOW)
    target = Store.open(str(tmp_path / "copy"))
    assert copy_store(catalog.store, target).damaged == []
    assert total(Sightings(target).read(folder)) == 0
    assert Verification(target).run().findings == []
