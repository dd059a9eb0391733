"""Submission of a map whose source file is being collected: in every order, the build finds the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from firstfix.builds.callers import CallerUsage
from firstfix.builds.options import BuildOptions
from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_state import Event
from firstfix.catalog.sources import put_source, source_key
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.errors import NotFound
from firstfix.maintenance.garbage import Ages, collect_garbage
from firstfix.maintenance.rebuild import rebuild
from firstfix.store.store import Store
from firstfix_builder.job.fetch_source import SourceFetch
from firstfix_service.auth.principal import Principal
from firstfix_service.http_api.bodies.form import FormFile
from firstfix_service.http_api.bodies.submission import NamedUpload, Submission
from firstfix_service.http_api.routes.maps import _record
from firstfix_service.limits.disk_space import DiskSpace
from tests.interleavings import Step, run_every_order, run_interleaved

CONTENT = b"0 0 0\n1 1 1\n"
CALLER = Principal("key:0123456789ab")
ANY_AGE = Ages(things_s=-5, builds_s=-5)


def parts_of(store: Store) -> Any:
    catalog = Catalog(store)
    uploads = SimpleNamespace(store=store, uploads=Uploads(store), disks=DiskSpace(0))
    return uploads, SimpleNamespace(catalog=catalog, usage=CallerUsage(catalog.builds))


def collect(store: Store) -> None:
    # of one map: builds and uploads are not collected
    collect_garbage(Catalog(store), map_id="hall", ages=ANY_AGE)


def fetched(store: Store, build_id: str, folder: Path) -> bytes:
    named = Catalog(store).builds.request(build_id)["source"]
    path = SourceFetch(BuildOptions(build_id=build_id, work=folder / build_id), store, "hall").fetch(
        named, "a.xyz"
    )
    content = path.read_bytes()
    path.unlink()
    return content


@pytest.fixture(params=["file", "upload"])
def submission(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Submission, Callable[[Store], None]]:
    """A submission, and a function that puts what it needs into the store."""
    path = tmp_path / "a.xyz"
    path.write_bytes(CONTENT)

    def put_upload(store: Store) -> None:
        uploads = Uploads(store)
        uploads.create("u1", size_bytes=len(CONTENT), file_name="a.xyz")
        uploads.append(uploads.get("u1"), CONTENT)

    if request.param == "file":
        return Submission(CALLER, "hall", FormFile(path, "a.xyz"), None, {}), lambda store: None
    return Submission(CALLER, "hall", NamedUpload("u1"), None, {}), put_upload


@pytest.mark.parametrize("first", ["post", "collect"])
def test_an_accepted_build_finds_its_source(submission, first, tmp_path, monkeypatch):
    handed_in, prepare = submission

    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        prepare(store)
        put_source(store, "hall", tmp_path / "a.xyz")  # of a build long ago
        works: list[Callable[[], Any]] = [
            lambda: _record(*parts_of(store), "b1", handed_in, False),
            lambda: collect(store),
        ]
        if first == "collect":
            works.reverse()
        steps = run_interleaved(works, switches, monkeypatch=monkeypatch)
        assert fetched(store, "b1", tmp_path / "work") == CONTENT
        collect(store)
        assert fetched(store, "b1", tmp_path / "work") == CONTENT
        return steps

    run_every_order(run)


def test_a_request_repeated_after_a_kill_finds_its_source(tmp_path, monkeypatch):
    (tmp_path / "a.xyz").write_bytes(CONTENT)
    handed_in = Submission(CALLER, "hall", FormFile(tmp_path / "a.xyz", "a.xyz"), None, {})

    def run(kill_at: int, switches: tuple[int, ...]) -> int:
        store = Store.open("memory://")
        put_source(store, "hall", tmp_path / "a.xyz")
        works: list[Callable[[], Any]] = [
            lambda: _record(*parts_of(store), "b1", handed_in, True),
            lambda: collect(store),
        ]
        steps = run_interleaved(works, switches, kill_at=kill_at, monkeypatch=monkeypatch)
        _record(*parts_of(store), "b1", handed_in, True)
        collect(store)
        assert fetched(store, "b1", tmp_path / "work") == CONTENT
        return len(steps)

    calls = run(1000, ())
    for kill_at in range(calls):
        for start in range(kill_at + 1):
            for length in (2, 4, calls):
                run(kill_at, (start, start + length))


def test_leftovers_of_a_killed_collection_are_collected(tmp_path, monkeypatch):
    (tmp_path / "a.xyz").write_bytes(CONTENT)
    handed_in = Submission(CALLER, "hall", FormFile(tmp_path / "a.xyz", "a.xyz"), None, {})

    def run(kill_at: int) -> int:
        store = Store.open("memory://")
        put_source(store, "hall", tmp_path / "a.xyz")
        works: list[Callable[[], Any]] = [lambda: collect(store), lambda: None]
        steps = run_interleaved(works, (), kill_at=kill_at, monkeypatch=monkeypatch)
        _record(*parts_of(store), "b1", handed_in, False)
        assert fetched(store, "b1", tmp_path / "work") == CONTENT
        Catalog(store).builds.set_status("b1", new_status("failed", map_id="hall"))
        collect_garbage(Catalog(store), ages=ANY_AGE)
        assert [key for key in store.list() if not key.startswith(("maps/hall/log/", "callers/"))] == []
        return len(steps)

    for kill_at in range(run(1000)):
        run(kill_at)


def test_a_rebuilt_map_finds_its_source(tmp_path, monkeypatch):
    (tmp_path / "a.xyz").write_bytes(CONTENT)
    version = "a" * 64

    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        catalog = Catalog(store)
        sha256 = put_source(store, "hall", tmp_path / "a.xyz")
        catalog.builds.put("old", {"map_id": "hall", "source": {"key": source_key("hall", sha256)}})
        for event in (Event.PUBLISHED, Event.ACTIVATED):
            catalog._map_log("hall").append(event, version, build_id="old", needed=lambda state: True)
        made: list[str] = []

        def collect_all() -> None:
            Catalog(store).retire("hall", version, force=True)
            Catalog(store).builds.set_status("old", new_status("failed", map_id="hall"))
            for key in store.list("builds/old"):
                store.delete(key)
            collect(store)

        def build_again() -> None:
            try:
                made.append(rebuild(Catalog(store), "hall"))
            except NotFound:  # reported to the caller
                return

        steps = run_interleaved([build_again, collect_all], switches, monkeypatch=monkeypatch)
        for build_id in made:
            assert fetched(store, build_id, tmp_path / "work") == CONTENT
        return steps

    run_every_order(run)
