"""A build that made no full version leaves nothing but its record, and takes nothing that others need."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.sources import put_source, source_key
from firstfix.maintenance.build_end import end_build
from firstfix.maintenance.repair import Repair
from firstfix.store.json_record import RecordKind
from firstfix.store.store import Store
from tests.core.fixtures import publish
from tests.interleavings import run_interleaved


def recorded(catalog: Catalog, tmp_path: Path, build_id: str, content: str = "a cloud") -> str:
    """Records a build that runs. Returns the key of its source."""
    (tmp_path / "source").write_text(content)
    key = source_key("hall", put_source(catalog.store, "hall", tmp_path / "source"))
    catalog.builds.put(build_id, {"map_id": "hall", "source": {"key": key}, "config": {}})
    catalog.builds.set_status(build_id, new_status("running", map_id="hall"))
    return key


def published(catalog: Catalog, tmp_path: Path, build_id: str, *, provisional: bool) -> str:
    content = "coarse" if provisional else "fine"
    version = publish(catalog, tmp_path, content, build_id=build_id, provisional=provisional)
    status = new_status("running", map_id="hall", provisional_version=version if provisional else None)
    catalog.builds.set_status(build_id, status)
    return version


def ended(state: str = "cancelled", **changes: Any) -> dict[str, Any]:
    return {**new_status(state, map_id="hall"), **changes}


@pytest.mark.parametrize(("state", "words"), [("cancelled", "been cancelled"), ("failed", "failed")])
def test_the_provisional_version_and_the_source_of_an_ended_build_go(
    any_catalog, tmp_path, state: str, words: str, caplog
):
    recorded(any_catalog, tmp_path, "b1")
    version = published(any_catalog, tmp_path, "b1", provisional=True)
    for _ in range(2):
        end_build(any_catalog, "b1", ended(state))
        told = f"its provisional version {version[:12]} answers no more, as its build b1 has {words}"
        assert [told in record.getMessage() for record in caplog.records] == [True], "once, and loudly"
        assert any_catalog.active_version("hall") is None
        assert any_catalog.builds.status("b1")["state"] == state
        assert any_catalog.store.list("maps/hall/sources") == []


def test_the_version_before_serves_again(any_catalog: Catalog, tmp_path: Path):
    """The map had a provisional version of another build, which still runs."""
    recorded(any_catalog, tmp_path, "b1")
    before = published(any_catalog, tmp_path, "b1", provisional=True)
    recorded(any_catalog, tmp_path, "b2", "another cloud")
    publish(any_catalog, tmp_path, "another", build_id="b2", provisional=True)
    end_build(any_catalog, "b2", ended())
    assert any_catalog.active_version("hall") == before


def test_sources_of_another_build_stay(any_catalog: Catalog, tmp_path: Path):
    key = recorded(any_catalog, tmp_path, "b1")
    recorded(any_catalog, tmp_path, "b2")
    version = published(any_catalog, tmp_path, "b1", provisional=True)
    any_catalog.builds.set_status("b2", new_status("running", map_id="hall", provisional_version=version))
    end_build(any_catalog, "b1", ended())
    assert any_catalog.active_version("hall") == version
    assert any_catalog.store.list("maps/hall/sources") == [key]
    end_build(any_catalog, "b2", ended("failed"))
    assert any_catalog.store.list("maps/hall/sources") == []


def test_a_full_version_that_was_published_stays_with_its_source(any_catalog: Catalog, tmp_path: Path):
    """The process was killed after the publication, before it recorded its success."""
    key = recorded(any_catalog, tmp_path, "b1")
    version = published(any_catalog, tmp_path, "b1", provisional=False)
    end_build(any_catalog, "b1", ended())
    assert any_catalog.active_version("hall") == version
    assert any_catalog.store.list("maps/hall/sources") == [key]


def test_a_kill_on_the_way_is_mended_by_a_repeat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def run(kill_at: int) -> int:
        catalog = Catalog(Store.open("memory://"))
        recorded(catalog, tmp_path, "b1")
        published(catalog, tmp_path, "b1", provisional=True)
        works: list[Callable[[], Any]] = [lambda: end_build(catalog, "b1", ended()), lambda: None]
        steps = run_interleaved(works, (), kill_at=kill_at, monkeypatch=monkeypatch)
        if catalog.builds.status("b1")["state"] == "cancelled":
            assert catalog.active_version("hall") is None, "whoever sees the end sees no version"
        end_build(Catalog(catalog.store), "b1", ended())
        assert catalog.store.list("maps/hall/sources") == []
        assert catalog.active_version("hall") is None
        return len(steps)

    for kill_at in range(run(1_000_000)):
        run(kill_at)


@pytest.mark.parametrize("full", [False, True])
def test_a_damaged_status_is_repaired_with_what_the_build_has_published(any_catalog, tmp_path, full: bool):
    recorded(any_catalog, tmp_path, "b1")
    early = published(any_catalog, tmp_path, "b1", provisional=True)
    if full:
        version = published(any_catalog, tmp_path, "b1", provisional=False)
    any_catalog.store.put("builds/b1/status.json", b"")
    said = Repair(any_catalog.store).record("builds/b1/status.json", RecordKind.BUILD_STATUS)
    status = any_catalog.builds.status("b1")
    if full:
        assert (status["state"], status["version"]) == ("succeeded", version)
        assert status["provisional_version"] == early
    else:
        assert said.endswith("the build is queued again")
        assert status["state"] == "queued", "a provisional version is not the build's end"
