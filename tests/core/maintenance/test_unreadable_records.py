"""A damaged record of any kind affects nothing else: all other work goes on."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.builds.attempts import AttemptEnd, BuildAttempts
from firstfix.builds.callers import CallersKey, claim_build
from firstfix.builds.records import UNREADABLE, new_status
from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.geopose import Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from firstfix.catalog.sightings.sightings import Sightings
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.catalog.versions.objects import VersionFolder
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import Tally
from firstfix.errors import UnreadableRecord
from firstfix.maintenance.backup import copy_store
from firstfix.maintenance.checked_objects import CheckedObjects
from firstfix.maintenance.garbage import Ages, collect_garbage
from firstfix.maintenance.record_kinds import FORMS, form_of, why_unreadable
from firstfix.store.json_record import RecordKind, max_bytes
from firstfix.store.store import Store
from tests.core.fixtures import publish
from tests.frequent_snapshots import EVERY

STAGES = ("a" * 64, "b" * 64)
QUERY_IDS = ("20260101t000000000000-0000000a", "20260102t000000000000-0000000b")
_CELLS = np.arange(5)
SIGHTED = Tally.of(Sighting((1, 2, 3), _CELLS, _CELLS[:0], _CELLS[:2], _CELLS[:0]))
IDEMPOTENCY = (CallersKey("robot", "key-1"), CallersKey("robot", "key-2"))


def wrong_types(record: bytes) -> bytes:
    """Record whose fields have values of another type."""
    values = json.loads(record)
    odd: Any = [[None]]
    return json.dumps(dict.fromkeys(values or {"x": 1}, odd)).encode()


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "cut off": lambda data: data[: len(data) // 2],
    "no JSON": lambda data: b"\xff\xfe\x00" + data,
    "no object": lambda data: b"[" + data + b"]",
    "a number": lambda data: b"17",
    "wrong types": wrong_types,
    "deep": lambda data: b'{"a":' * 100_000,
    "not a number": lambda data: b'{"a": NaN}',
}

# One record of each kind, which is damaged. What it is about may be unreadable or as if it were not there.
DAMAGED: dict[RecordKind, tuple[str, set[str]]] = {
    RecordKind.BUILD_REQUEST: ("builds/b1/request.json", {"status of b1", "request of b1"}),
    RecordKind.BUILD_STATUS: ("builds/b2/status.json", {"status of b2"}),
    RecordKind.BUILD_STAGES: ("builds/b2/stages.json", {"stages of b2"}),
    RecordKind.BUILD_ATTEMPT: ("builds/b1/attempts/000001.end.json", set()),
    RecordKind.LOG_ENTRY: ("maps/hall/log/000003.json", {"map hall", "sightings of hall"}),
    RecordKind.LOG_SNAPSHOT: (f"maps/yard/snapshots/{EVERY:06d}.json", set()),
    RecordKind.CHANGE_NOTICE: ("changes/00000001.json", set()),
    RecordKind.UPLOAD: ("uploads/u1/upload.json", {"upload u1"}),
    RecordKind.UPLOAD_WHOLE: ("uploads/u2/whole.json", set()),
    RecordKind.API_KEY: ("keys/{key}.json", {"key first"}),
    RecordKind.RECORDED_QUERY: (f"recorded-queries/{QUERY_IDS[0]}.json", {f"recorded query {QUERY_IDS[0]}"}),
    RecordKind.IDEMPOTENCY_KEY: ("idempotency/{claim}", {"claim key-1"}),
    RecordKind.GEOREFERENCE: ("maps/hall/georeference/000002.json", {"georeference of hall"}),
    RecordKind.SHARED_STAGE: (f"stages/{STAGES[0]}/stage.json", {f"stage {STAGES[0]}"}),
    RecordKind.CHECKED_OBJECTS: ("checked/hall.json", set()),
    RecordKind.SIGHTINGS: ("{sightings}", {"sightings of hall"}),
}


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Objects of a store with two or more records of every kind."""
    store = Store.open("memory://")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("firstfix.catalog.log.map_log.ENTRIES_PER_SNAPSHOT", EVERY)
        _fill(store, tmp_path_factory.mktemp("filled"))
    return {key: store.get(key) for key in store.list()}


@pytest.fixture
def store(filled: dict[str, bytes], frequent_snapshots: None) -> Store:
    store = Store.open("memory://")
    for key, data in filled.items():
        store.put(key, data)
    return store


def _fill(store: Store, tmp_path: Path) -> None:
    catalog = Catalog(store)
    for map_id in ("hall", "yard"):
        for content in ("1", "2"):
            publish(catalog, tmp_path / map_id, content, map_id)
        georeferences = Georeferences(store)
        for latitude_deg in (47.0, 48.0):
            georeferences.set(map_id, Georeference(latitude_deg, 11.0, 500.0, (0.0, 0.0, 0.0, 1.0)))
        (item, *_) = store.scan(f"maps/{map_id}/versions")
        checked = CheckedObjects(store, map_id)
        checked.note(item)
        checked.save({item.key})
    for _ in range(EVERY):
        catalog.roll_back("yard")
    for build_id in ("b1", "b2", "b3"):
        catalog.builds.put(build_id, {"map_id": "hall", "source": {"key": "maps/hall/sources/x"}})
        attempts = BuildAttempts(store, "me", lease_s=30, max_attempts=3)
        attempt = attempts.claim(build_id, "")
        assert attempt is not None
        attempts.end(attempt, AttemptEnd.STOPPED)
    for build_id in ("b2", "b3"):
        catalog.builds.set_status(build_id, new_status("failed", map_id="hall"))
        catalog.builds.set_stages(build_id, [{"stage": "cluster", "seconds": 1.5, "cached": False}])
    uploads = Uploads(store)
    for upload_id in ("u1", "u2"):
        uploads.create(upload_id, size_bytes=3, file_name="a.ply")
        uploads.finish(uploads.append(uploads.get(upload_id), b"abc"))
    keys = ApiKeys(store)
    for name in ("first", "second"):
        keys.create(name, Grant.parse(["localize"], ["*"]))
    recorded_queries = RecordedQueries(store)
    for query_id in QUERY_IDS:
        answer = {"verdict": "rejected", "reasons": [], "probability": 0.1}
        recorded = RecordedQuery(query_id, "2026-01-01", "http", "r", "", "hall", "x/y", "", {}, answer, 4)
        recorded_queries.put(recorded, b"body")
    for key in IDEMPOTENCY:
        claim_build(store, key, "same", "b1")
    for map_id in ("hall", "yard"):
        Sightings(store).put(newest(catalog, map_id), SIGHTED, datetime.now(timezone.utc))
    for stage in STAGES:
        SharedStages(store).put(stage, "mesh", tmp_path / "hall" / "1")


def newest(catalog: Catalog, map_id: str) -> VersionFolder:
    return catalog.folder_of(map_id, catalog.state(map_id).published[-1])


def everything(store: Store, scratch: Path) -> dict[str, Any]:
    """Everything that fresh readers see in a store; error codes for what cannot be read."""
    catalog, uploads = Catalog(store), Uploads(store)
    keys, _ = ApiKeys(store).all()
    notices, end = catalog.changes.since(0)
    found: dict[str, Any] = {f"key {key.name}": key for key in keys}
    found |= {f"recorded query {recorded.query_id}": recorded for recorded in RecordedQueries(store).each()}
    found |= {"notices": (set(notices) >= {"yard"}, end)}
    for map_id in catalog.map_ids():
        found[f"map {map_id}"] = catalog.state(map_id)
        days = Sightings(store).read(newest(catalog, map_id)).days
        found[f"sightings of {map_id}"] = sum(day.tally.sightings for day in days.values())
        found[f"georeference of {map_id}"] = _said(Georeferences(store).get, map_id)
    for build_id in catalog.builds.ids():
        found[f"status of {build_id}"] = catalog.builds.shown_status(build_id)
        found[f"request of {build_id}"] = _said(catalog.builds.request, build_id)
        found[f"stages of {build_id}"] = _said(catalog.builds.stages, build_id)
    for upload_id in uploads.ids():
        upload = _said(uploads.get, upload_id)
        found[f"upload {upload_id}"] = upload if isinstance(upload, str) else uploads.finish(upload)
    for key in IDEMPOTENCY:
        found[f"claim {key.key}"] = _said(claim_build, store, key, "same", "b9")
    for stage in STAGES:
        folder = Path(tempfile.mkdtemp(dir=scratch))
        found[f"stage {stage}"] = SharedStages(store).fetch(stage, folder)
    return found


def _said(read: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return read(*arguments)
    except UnreadableRecord as error:
        return error.code


def damaged_key(store: Store, kind: RecordKind) -> str:
    claim = IDEMPOTENCY[0].name.split("/")[-1]
    first = next(key for key in ApiKeys(store).all()[0] if key.name == "first")
    (sightings,) = store.list(f"{newest(Catalog(store), 'hall').key}/sightings")
    return DAMAGED[kind][0].format(claim=claim, key=first.key_id, sightings=sightings)


def test_every_kind_is_here():
    assert set(DAMAGED) == set(RecordKind) == {form.kind for form in FORMS}


@pytest.mark.slow
@pytest.mark.parametrize("kind", RecordKind, ids=lambda kind: kind.value)
@pytest.mark.parametrize("damage", [*DAMAGES, "too large"])
def test_all_else_goes_on(kind: RecordKind, damage: str, store: Store, tmp_path: Path):
    key = damaged_key(store, kind)
    before = everything(store, tmp_path)
    good = store.get(key)
    form = form_of(key)
    assert form is not None
    assert form.kind is kind
    assert why_unreadable(key, good) is None
    bad = good + b" " * max_bytes(kind) if damage == "too large" else DAMAGES[damage](good)
    store.put(key, bad)
    assert why_unreadable(key, bad) is not None

    told: list[UnreadableRecord] = []
    store.unreadable.listen(told.append)
    after = everything(store, tmp_path)
    about = DAMAGED[kind][1]
    assert all(after[name] == before[name] for name in before.keys() - about)
    for build_id in ("b1", "b2"):
        if f"status of {build_id}" in about:
            assert after[f"status of {build_id}"]["state"] == UNREADABLE
    if kind is RecordKind.BUILD_ATTEMPT:
        assert BuildAttempts(store, "you", lease_s=30, max_attempts=3).claim("b1", "") is not None
    if kind is RecordKind.CHECKED_OBJECTS:
        CheckedObjects(store, "hall")
    assert {(error.kind, error.key) for error in told} == {(kind.value, key)}, "counted once, by its kind"

    report = copy_store(store, Store.open("memory://"))
    lasts = key.startswith(("maps/", "builds/", "keys/")) and kind is not RecordKind.SIGHTINGS
    assert report.damaged == ([key] if lasts else [])

    garbage = collect_garbage(Catalog(store), ages=Ages(things_s=-60, builds_s=-60, logs_s=-60))
    assert {found.split("/")[1] for found in garbage.keys["uploads"]} == {"u1", "u2"}
    assert len(garbage.keys["idempotency"]) == 2
    ended = {"b3"} | ({"b2"} if "status of b2" not in about else set())
    assert {found.split("/")[1] for found in garbage.keys["builds"]} == ended


def test_a_mended_record_is_read_again(store: Store):
    told: list[UnreadableRecord] = []
    store.unreadable.listen(told.append)
    catalog = Catalog(store)
    key = "builds/b2/status.json"
    good = store.get(key)
    for _ in range(2):
        store.put(key, b"")
        assert catalog.builds.shown_status("b2")["state"] == UNREADABLE
        assert catalog.builds.shown_status("b2")["map_id"] == "hall", "its request says it"
        store.put(key, good)
        assert catalog.builds.shown_status("b2")["state"] == "failed"
    assert len(told) == 2, "once each time that it was damaged"


def test_a_damaged_stage_is_shared_again(store: Store, tmp_path: Path):
    made = tmp_path / "hall" / "1"
    (file,) = (key for key in store.list(f"stages/{STAGES[0]}") if not key.endswith("stage.json"))
    store.put(file, b"x" * store.size(file))
    store.put(f"stages/{STAGES[0]}/stage.json", b"")
    SharedStages(store).put_surely(STAGES[0], "mesh", made)
    (folder := tmp_path / "fetched").mkdir()
    assert SharedStages(store).fetch(STAGES[0], folder)


def test_a_lost_log_entry_keeps_the_files_that_it_may_have_published(store: Store):
    catalog = Catalog(store)
    (first, second) = catalog.state("hall").published
    store.put("maps/hall/log/000003.json", b"")  # by which the second one was published
    catalog = Catalog(store)
    assert catalog.state("hall").published == (first,)
    found = collect_garbage(catalog, ages=Ages(things_s=-60))
    assert found.keys["versions"] == []
    assert any(second in key for key in store.list("maps/hall/versions"))


def test_a_source_that_a_damaged_request_may_name_stays(store: Store):
    store.put("maps/hall/sources/" + "c" * 64, b"cloud")
    store.put("builds/b1/request.json", b"")
    found = collect_garbage(Catalog(store), ages=Ages(things_s=-60, builds_s=1e9))
    assert found.keys["sources"] == []
