"""Provenance of versions and builds over HTTP: who may see what."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from firstfix.access.api_keys import ApiKeys, parse_token
from firstfix.access.permissions import Grant
from firstfix.builds.records import new_status
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.provenance import Provenance
from firstfix.store.store import Store
from tests.service.access_world import bearer, get
from tests.service.service_world import Service, running_service

WHO = {"caller", "host", "command"}


@pytest.fixture
def keys(tmp_path: Path) -> dict[str, str]:
    made = ApiKeys(Store.open(str(tmp_path / "store")))
    names = {"robot": "localize", "maker": "build", "other": "build", "admin": "admin"}
    return {name: made.create(name, Grant.parse([scope], ["*"]))[1] for name, scope in names.items()}


@pytest.fixture
def guarded(tmp_path: Path, keys: dict[str, str]) -> Iterator[Service]:
    with running_service(tmp_path, auth="on", zenoh=False) as running:
        yield running


def submit(service: Service, key: str, **form: str) -> Any:
    files = {"source": ("../plans/hall.xyz", b"0 0 0\n")}
    return service.http.post("/maps", data={"map_id": "hall", **form}, files=files, headers=bearer(key))


def test_who_made_a_version_is_for_its_maker_and_for_admins(guarded: Service, keys: dict[str, str]):
    maker = f"key:{parse_token(keys['maker'])[0]}"  # type: ignore[index]
    folder = guarded.scratch / "one"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("1")
    manifest = Manifest.for_directory(folder, sensor={"name": "os0-64"})
    made = Provenance(
        "hall.laz", 9, "ab" * 32, note="a note", caller=maker, host="pc7", command="firstfix build"
    )
    version = guarded.catalog.publish("hall", folder, manifest, provenance=made)
    for name, sees in (("robot", False), ("other", False), ("maker", True), ("admin", True)):
        (listed,) = get(guarded, "/maps/hall/versions", keys[name]).json()["versions"]
        single = get(guarded, f"/maps/hall/versions/{version}", keys[name]).json()
        of_map = get(guarded, "/maps/hall", keys[name]).json()
        for shown in (listed, single, of_map):
            told = shown["provenance"]
            assert (told["file_name"], told["size_bytes"], told["note"]) == ("hall.laz", 9, "a note")
            assert {one for one in WHO if told.get(one)} == (WHO if sees else set()), name
            assert shown["summary"]["sensor"] == "os0-64"


def test_a_build_keeps_its_note_and_file(guarded: Service, keys: dict[str, str]):
    answer = submit(guarded, keys["maker"], note="before the move")
    assert answer.status_code == 202, answer.text
    place = answer.headers["location"]
    for name, sees in (("maker", True), ("other", False), ("admin", True)):
        shown = get(guarded, place, keys[name]).json()
        assert (shown["file_name"], shown["note"]) == ("hall.xyz", "before the move")
        assert (shown["caller"] is not None) is sees, name


def test_a_long_note_is_refused(guarded: Service, keys: dict[str, str]):
    refused = submit(guarded, keys["maker"], note="x" * 501)
    assert (refused.status_code, refused.json()["code"]) == (400, "invalid_option")


def test_the_log_of_a_build_is_for_admins(guarded: Service, keys: dict[str, str]):
    place = submit(guarded, keys["maker"]).headers["location"]
    build_id = place.rsplit("/", 1)[-1]
    assert get(guarded, f"{place}/log", keys["maker"]).status_code == 403
    assert get(guarded, f"{place}/log", keys["admin"]).status_code == 404, "no attempt has ended"
    records = guarded.catalog.builds
    records.set_status(build_id, new_status("failed", map_id="hall"))
    records.set_log(build_id, "x" * 100_000 + f"\nkey {keys['admin']}\nthe end")
    log = get(guarded, f"{place}/log", keys["admin"]).text
    assert log.endswith("the end")
    assert len(log) <= 64 << 10
    assert keys["admin"] not in log
