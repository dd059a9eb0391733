"""A real service with the real builder: answers before the full version is there, and rebuilds of a part."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix_builder.pipeline import build_version
from tests.builder.test_incremental import CONFIG, corridor
from tests.service.builds_world import wait_until_ended
from tests.service.service_world import Service, running_service
from tests.waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # a map is built three times


def load(directory: Path) -> Localizer:
    return Localizer(MapIndex.load(directory))


def submit(service: Service, source: Path, **config: bool):
    answer = service.http.post(
        "/maps",
        data={"map_id": "hall", "config": json.dumps({**CONFIG, **config})},
        files={"source": (source.name, source.read_bytes())},
    )
    assert answer.status_code == 202, answer.text
    return answer


def test_a_map_posted_twice_is_provisional_first_and_then_rebuilt_in_part(tmp_path: Path):
    before = corridor(tmp_path / "map.ply")
    worker = (sys.executable, "-m", "firstfix_builder.worker")
    changes = {"zenoh": False, "run_builds": True, "build_command": worker, "load": load}
    with running_service(tmp_path, **changes) as service:
        first = submit(service, before)
        wait_until(lambda: service.ask_http().ok)
        early = service.ask_http().json
        ended = wait_until_ended(service, first)
        assert ended["state"] == "succeeded", ended
        assert ended["version"] != ended["provisional_version"]
        assert early["map_provisional"] is (early["map_version"] == ended["provisional_version"])
        wait_until(lambda: not service.ask_http().json["map_provisional"])
        assert service.ask_http().json["map_version"] == ended["version"]
        (version,) = service.http.get("/maps/hall/versions").json()["versions"]
        assert (version["version"], version["provisional"]) == (ended["version"], False)
        events = [(e.event.value, e.version) for e in service.catalog.log("hall")]
        assert events == [
            ("published", ended["provisional_version"]),
            ("activated", ended["provisional_version"]),
            ("published", ended["version"]),
            ("activated", ended["version"]),
            ("retired", ended["provisional_version"]),
        ]
        assert [stage["stage"] for stage in ended["stages"]].count("provisional") == 1

        after = corridor(tmp_path / "changed" / "map.ply", changed=True)
        again = wait_until_ended(service, submit(service, after, exact=True))
        assert again["state"] == "succeeded", again
        assert again["provisional_version"] is None
        templates = {stage["stage"]: stage for stage in again["stages"]}["make_templates"]
        assert 0 < templates["chunks_reused"] < templates["chunks"]
        fresh = build_version(after, BuildConfig.parse(CONFIG), tmp_path / "fresh")
        assert again["version"] == fresh.manifest.digest
