"""Requests of rebuilds from the sources, and of patches where the map's config or the caller allows them."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.sightings.sightings import Sightings
from firstfix.catalog.sources import put_source, source_key
from firstfix.engine.changes.cells import keys_of
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import Tally
from firstfix.errors import Conflict, NotFound
from firstfix.maintenance.patch import hour_of, request_due_patches, request_patch
from firstfix.maintenance.rebuild import rebuild
from firstfix.store.store import Store
from tests.core.fixtures import make_version, publish


def built(catalog: Catalog, scratch: Path, content: str = "1", *, patch: str = "off", **values: Any) -> str:
    """Publishes a version of a recorded build with a source. Returns the version."""
    scratch.mkdir(exist_ok=True)
    (scratch / f"{content}.laz").write_text(content)
    key = source_key("hall", put_source(catalog.store, "hall", scratch / f"{content}.laz"))
    request = {"map_id": "hall", "source": {"key": key}, "file_name": "hall.laz", "trajectory": None}
    request |= {"config": {"patch": patch}, "owner": "key:k1", "traceparent": "00-1"}
    catalog.builds.put(f"b{content}", request)
    return publish(catalog, scratch, content, build_id=f"b{content}", **values)


def test_a_rebuild_repeats_the_build_of_the_active_version(catalog: Catalog, tmp_path: Path):
    version = built(catalog, tmp_path, "1", format=1)
    catalog.retire("hall", built(catalog, tmp_path, "2", patch="propose"), force=True)
    assert catalog.active_version("hall") == version
    build_id = rebuild(catalog, "hall")
    request = catalog.builds.request("b1")
    del request["traceparent"], request["owner"]
    asked = catalog.builds.request(build_id)
    assert asked.pop("command") == f"rebuild of version {version}"
    config = request.pop("config")
    assert asked.pop("config") == {**config, "exact": True}, "nothing was kept of another version"
    assert asked == request
    assert catalog.builds.status(build_id)["state"] == "queued"
    assert catalog.builds.ids()[0] == build_id, "its time sorts before b1"


def test_a_rebuild_keeps_of_the_same_version_unless_it_is_exact(catalog: Catalog, tmp_path: Path):
    base = built(catalog, tmp_path, "1")
    built(catalog, tmp_path, "2", config={"base": base})
    again, exact = rebuild(catalog, "hall"), rebuild(catalog, "hall", exact=True)
    assert catalog.builds.request(again)["config"] == {"patch": "off", "base": base}
    assert catalog.builds.request(exact)["config"] == {"patch": "off", "exact": True}


def test_a_rebuild_without_its_source_is_refused(catalog: Catalog, tmp_path: Path):
    built(catalog, tmp_path)
    catalog.store.delete(catalog.builds.request("b1")["source"]["key"])
    with pytest.raises(NotFound, match="source of map hall is gone"):
        rebuild(catalog, "hall")
    assert catalog.builds.ids() == ["b1"]


def test_a_rebuild_without_a_record_is_refused(catalog: Catalog, tmp_path: Path):
    publish(catalog, tmp_path, "1")
    with pytest.raises(NotFound, match="without a record"):
        rebuild(catalog, "hall")
    with pytest.raises(NotFound, match="no active version"):
        rebuild(catalog, "attic")


def test_a_patch_is_a_build_of_the_same_sources(catalog: Catalog, tmp_path: Path):
    version = built(catalog, tmp_path, patch="propose")
    request = catalog.builds.request(request_patch(catalog, "hall"))
    assert request.pop("patch") == {"base": version, "mode": "propose"}
    assert version in request.pop("command")
    before = catalog.builds.request("b1")
    assert request == {name: before[name] for name in request}
    assert "owner" not in request


def test_patches_are_off_unless_the_map_or_the_caller_says_otherwise(catalog: Catalog, tmp_path: Path):
    built(catalog, tmp_path, patch="off")
    with pytest.raises(Conflict, match="patches of map hall are off"):
        request_patch(catalog, "hall")
    assert catalog.builds.ids() == ["b1"]
    build_id = request_patch(catalog, "hall", "activate")
    assert catalog.builds.request(build_id)["patch"]["mode"] == "activate"
    assert catalog.builds.request(build_id)["config"] == {"patch": "off"}, "of this build alone"


def test_a_map_without_a_full_version_is_not_patched(catalog: Catalog, tmp_path: Path):
    with pytest.raises(NotFound):
        request_patch(catalog, "hall", "propose")
    built(catalog, tmp_path, patch="propose", provisional=True)
    with pytest.raises(Conflict, match="provisional"):
        request_patch(catalog, "hall")


def test_a_rebuild_repeats_no_patch(catalog: Catalog, tmp_path: Path):
    version = built(catalog, tmp_path, patch="propose")
    build_id = request_patch(catalog, "hall")
    publish(catalog, tmp_path, "patched", build_id=build_id)
    assert catalog.active_version("hall") != version
    assert "patch" not in catalog.builds.request(rebuild(catalog, "hall"))


def test_off_in_a_yaml_config_means_no_patches(tmp_path: Path):
    for text, mode in (("patch: off", "off"), ("patch: propose", "propose"), ("{}", "off")):
        (tmp_path / "config.yaml").write_text(text)
        assert BuildConfig.from_file(tmp_path / "config.yaml").patch == mode
    assert "patch" not in BuildConfig(patch="activate").to_mapping(), "it does not change the version"


PLACE = np.sort(keys_of(np.array([[x, 4, 2] for x in range(4)])))
NOTHING = np.empty(0, np.int64)
HOUR = datetime(2026, 3, 4, hour_of("hall"), 5, tzinfo=timezone.utc)


def see_changes(catalog: Catalog, version: str, days: int) -> None:
    """Counts of queries that have seen a place where something is gone, on so many days."""
    for day in range(days):
        spots = (Sighting((7 * n, day, 1), NOTHING, PLACE, NOTHING, NOTHING) for n in range(9))
        tally = Tally.sum([Tally.of(spot) for spot in spots])
        Sightings(catalog.store).put(catalog.folder_of("hall", version), tally, HOUR - timedelta(days=day))


def test_a_changed_map_is_patched_once_a_day(catalog: Catalog, tmp_path: Path):
    version = built(catalog, tmp_path, patch="activate")
    see_changes(catalog, version, 3)
    assert request_due_patches(catalog, HOUR - timedelta(hours=1)) == [], "not its hour"
    (build_id,) = request_due_patches(catalog, HOUR)
    assert catalog.builds.request(build_id)["patch"] == {"base": version, "mode": "activate"}
    assert build_id.startswith(f"{HOUR:%Y%m%dt%H}")
    assert request_due_patches(catalog, HOUR + timedelta(minutes=30)) == [], "another replica in this hour"
    assert len(request_due_patches(catalog, HOUR + timedelta(days=1))) == 1


def test_a_map_is_not_patched_by_itself_without_its_config_or_without_three_days(catalog, tmp_path):
    version = built(catalog, tmp_path, patch="propose")
    assert request_due_patches(catalog, HOUR) == []
    see_changes(catalog, version, 2)
    assert request_due_patches(catalog, HOUR) == []
    other = Catalog(Store.open("memory://"))
    see_changes(other, built(other, tmp_path / "off", patch="off"), 3)
    assert request_due_patches(other, HOUR) == []


def test_a_patch_that_waits_or_was_rolled_back_is_not_made_again(catalog: Catalog, tmp_path: Path):
    version = built(catalog, tmp_path, patch="propose")
    see_changes(catalog, version, 3)
    (build_id,) = request_due_patches(catalog, HOUR)
    folder = tmp_path / "patched"
    manifest = make_version(folder)
    catalog.publish("hall", folder, manifest, build_id=build_id, activate=False)
    tomorrow = HOUR + timedelta(days=1)
    assert request_due_patches(catalog, tomorrow) == [], "it waits for a person"
    catalog.activate("hall", manifest.digest)
    catalog.activate("hall", version)  # as a rollback does
    assert catalog.active_version("hall") == version
    assert request_due_patches(catalog, tomorrow) == [], "a person did not want it"
    catalog.retire("hall", manifest.digest)
    assert len(request_due_patches(catalog, tomorrow)) == 1
