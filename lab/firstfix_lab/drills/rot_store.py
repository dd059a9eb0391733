"""A small store with objects of every kind, and what its readers see in it."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.builds.attempts import AttemptEnd, BuildAttempts
from firstfix.builds.callers import CallersKey, claim_build, claimed_build
from firstfix.builds.records import new_status
from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.geopose import Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.log import map_log
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from firstfix.catalog.sightings.sightings import Sightings
from firstfix.catalog.sources import put_source
from firstfix.catalog.uploads.parts import part_key
from firstfix.catalog.uploads.uploads import Upload, Uploads
from firstfix.catalog.versions.objects import VersionFolder
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import Tally
from firstfix.errors import FirstfixError
from firstfix.maintenance.checked_objects import CheckedObjects
from firstfix.store.store import Store
from tests.small_world import COARSE_CONFIG, yard

EVERY = 4  # entries between two snapshots
QUERY_ID = "20260101t000000000000-0000000a"
STAGE = "a" * 64
CLAIM = CallersKey("robot", "key-1")
ABSENT = "absent"


def built_store(folder: Path) -> Store:
    """A store with one built map, by the command line."""
    (folder / "config.json").write_text(json.dumps(COARSE_CONFIG))
    line = ["build", yard().write(folder / "yard.ply"), "--map-id", "yard", "--store", folder / "store"]
    line += ["--config", folder / "config.json"]
    subprocess.run([sys.executable, "-m", "firstfix_cli.main", *map(str, line)], check=True)
    return Store.open(str(folder / "store"))


@contextmanager
def _frequent_snapshots() -> Iterator[None]:
    before, map_log.ENTRIES_PER_SNAPSHOT = map_log.ENTRIES_PER_SNAPSHOT, EVERY
    try:
        yield
    finally:
        map_log.ENTRIES_PER_SNAPSHOT = before


def fill(store: Store, scratch: Path) -> None:
    """Add objects of every kind: a map of two small versions, builds, keys, recorded queries, uploads."""
    catalog = Catalog(store)
    with _frequent_snapshots():
        for content in (b"1", b"2"):
            folder = scratch / content.decode()
            folder.mkdir(parents=True)
            (folder / "a.npy").write_bytes(100 * content)
            catalog.publish("hall", folder, Manifest.for_directory(folder), build_id="b2")
        for _ in range(EVERY - 1):
            catalog.roll_back("hall")
    (scratch / "hall.laz").write_bytes(b"a cloud of points")
    source = put_source(store, "hall", scratch / "hall.laz")
    for latitude_deg in (47.107739, 48.0):
        Georeferences(store).set("hall", Georeference(latitude_deg, 11.0, 500.0, (0.0, 0.0, 0.0, 1.0)))
    checked = CheckedObjects(store, "hall")
    checked.note(store.scan("maps/hall/versions")[0])
    checked.save({item.key for item in store.scan("maps/hall")})
    for build_id in ("b1", "b2"):
        key = f"maps/hall/sources/{source}"
        catalog.builds.put(build_id, {"map_id": "hall", "source": {"key": key}, "config": {"a": 1}})
        attempts = BuildAttempts(store, "me", lease_s=30, max_attempts=3)
        attempt = attempts.claim(build_id, "")
        assert attempt is not None
        attempts.end(attempt, AttemptEnd.ENDED, ran_s=12.5)
    catalog.builds.set_status(
        "b2", new_status("succeeded", map_id="hall", version=catalog.active_version("hall"))
    )
    catalog.builds.set_stages("b2", [{"stage": "cluster", "seconds": 1.5, "cached": False}])
    uploads = Uploads(store)
    for upload_id, size_bytes in (("whole", 6), ("half", 9)):
        uploads.create(upload_id, size_bytes=size_bytes, file_name="a.ply")
        for data in (b"abc", b"def"):
            uploads.append(uploads.get(upload_id), data)
    uploads.finish(uploads.get("whole"))
    for name in ("robot", "revoked"):
        key, _ = ApiKeys(store).create(name, Grant.parse(["localize"], ["hall"]))
    ApiKeys(store).revoke(key.key_id)
    answer = {"verdict": "localized", "reasons": [], "probability": 0.98, "T_map_sensor": [1.0, 2.0, 0.5]}
    recorded = RecordedQuery(
        QUERY_ID, "2026-01-01", "http", "r", "", "hall", "x/y", "", {"a": "b"}, answer, 9
    )
    RecordedQueries(store).put(recorded, b"some scan")
    RecordedQueries(store).set_truth(QUERY_ID, {"map_id": "hall"})
    claim_build(store, CLAIM, "same", "b1")
    cells = np.arange(5)
    tally = Tally.of(Sighting((1, 2, 3), cells, cells[:0], cells[:2], cells[:0]))
    for _ in range(2):
        Sightings(store).put(_active(catalog, "hall"), tally, datetime.now(timezone.utc))
    SharedStages(store).put(STAGE, "mesh", scratch / "1")


def look(store: Store, scratch: Path) -> dict[str, Any]:
    """Everything that fresh readers see; ``ABSENT`` for what cannot be read."""
    catalog, uploads, recorded_queries = Catalog(store), Uploads(store), RecordedQueries(store)
    keys, _ = ApiKeys(store).all()
    found: dict[str, Any] = {
        f"key {key.key_id}": (key.name, key.grant, key.sha256, key.expires_time, key.revoked) for key in keys
    }
    for map_id in catalog.folder_names():
        state = catalog.state(map_id)
        found[f"active {map_id}"] = state.active or ABSENT
        found[f"versions {map_id}"] = frozenset(state.published)
        found[f"georeference {map_id}"] = said(Georeferences(store).get, map_id)
        found[f"sightings {map_id}"] = said(_sightings, catalog, map_id)
        if state.active is not None:
            files = said(_files, catalog, map_id, state.active, scratch)
            found[f"files {map_id} {state.active}"] = files
    for build_id in catalog.builds.ids():
        status = said(catalog.builds.shown_status, build_id)
        is_shown = status != ABSENT and status["state"] != "unreadable"
        found[f"status {build_id}"] = status if is_shown else ABSENT
        known = ("map_id", "source", "trajectory", "config", "file_name", "owner")
        request = said(catalog.builds.request, build_id)
        found[f"request {build_id}"] = request if request == ABSENT else [request.get(name) for name in known]
        found[f"stages {build_id}"] = said(catalog.builds.stages, build_id)
        attempts = BuildAttempts(store, "you", lease_s=30, max_attempts=3)
        found[f"ran {build_id}"] = said(attempts.ran_s, build_id)
    for upload_id in uploads.ids():
        upload = said(uploads.get, upload_id)
        if upload != ABSENT:
            found[f"upload {upload_id}"] = (upload.size_bytes, upload.file_name, upload.sha256, upload.owner)
            found[f"offset {upload_id}"] = frozenset(range(upload.offset))
            if upload_id == "half":  # its sender goes on, and nobody compares the bytes yet
                found[f"bytes {upload_id}"] = _received(store, upload)
            else:
                kept = said(partial(uploads.keep_as_source, build_id="b9"), upload, "hall")
                key = f"maps/hall/sources/{kept}.b9"
                found["upload as source"] = kept if kept == ABSENT else store.get(key)
    for recorded in recorded_queries.each():
        told = {
            name: recorded.answer.get(name) for name in ("verdict", "reasons", "probability", "T_map_sensor")
        }
        truth = {name: value for name, value in recorded.truth.items() if name == "map_id"}
        about = (recorded.map_id, recorded.media_type, recorded.options, recorded.body_bytes, recorded.time)
        found[f"recorded query {recorded.query_id}"] = (told, truth, *about)
        found[f"body {recorded.query_id}"] = said(recorded_queries.body, recorded.query_id)
    found["claim"] = said(claimed_build, store, CLAIM) or ABSENT
    found["notices"] = frozenset(catalog.changes.since(0)[0])
    folder = scratch / "stage"
    folder.mkdir(parents=True, exist_ok=True)
    fetched = SharedStages(store).fetch(STAGE, folder)
    if fetched:  # otherwise a build makes it again
        found["stage"] = (folder / "a.npy").read_bytes()
    return found


def said(read: Callable[..., Any], *arguments: Any) -> Any:
    """The value; ``ABSENT`` if the reader refuses it in words."""
    try:
        return read(*arguments)
    except FirstfixError:
        return ABSENT


def _active(catalog: Catalog, map_id: str) -> VersionFolder:
    version = catalog.active_version(map_id)
    assert version is not None
    return catalog.folder_of(map_id, version)


def _received(store: Store, upload: Upload) -> frozenset[tuple[int, int]]:
    """The bytes with their places: fewer of them are a part."""
    offsets = [sum(upload.parts[:number]) for number in range(len(upload.parts))]
    data = b"".join(store.get(part_key(upload.upload_id, offset)) for offset in offsets)
    return frozenset(enumerate(data))


def _sightings(catalog: Catalog, map_id: str) -> frozenset[int]:
    """Numbers of the sightings from 0 on: fewer of them are a part."""
    if catalog.active_version(map_id) is None:
        return frozenset()
    days = Sightings(catalog.store).read(_active(catalog, map_id)).days
    return frozenset(range(sum(day.tally.sightings for day in days.values())))


def _files(catalog: Catalog, map_id: str, version: str, scratch: Path) -> str:
    """SHA-256 of all files of a version as a replica fetches them."""
    folder = catalog.fetch_version(map_id, version, scratch / "cache")
    digest = hashlib.sha256()
    for name in sorted(catalog.manifest(map_id, version).query_files):
        digest.update((folder / name).read_bytes())
    return digest.hexdigest()
