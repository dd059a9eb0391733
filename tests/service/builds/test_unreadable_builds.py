"""A damaged record of one build: all other builds are still listed, run, counted and collected."""

from __future__ import annotations

import pytest

from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.store.json_record import record_json
from firstfix.store.store import Store
from firstfix_service.builds.queue import UnfinishedBuilds
from firstfix_service.telemetry.metrics import Metrics
from tests.service.metrics_world import value
from tests.service.service_world import Service

BROKEN = [b"", b'{"map_id": "ha', b"[]", b'{"state": 3, "map_id": []}', b'{"a":' * 50_000]


def waiting_builds(store: Store) -> Catalog:
    catalog = Catalog(store)
    for build_id in ("b1", "b2", "b3"):
        catalog.builds.put(build_id, {"map_id": "hall"})
    return catalog


@pytest.mark.parametrize("record", BROKEN)
@pytest.mark.parametrize("name", ["request.json", "status.json"])
def test_the_queue_goes_on_with_the_others(record: bytes, name: str):
    catalog, metrics = waiting_builds(Store.open("memory://")), Metrics()
    catalog.store.put(f"builds/b2/{name}", record)
    queue = UnfinishedBuilds(catalog, metrics)
    assert [build.build_id for build in queue.find()] == ["b1", "b3"]
    assert metrics.registry.get_sample_value("firstfix_builds_waiting") == 2
    catalog.store.delete(f"builds/b2/{name}")
    catalog.store.put("builds/b2/request.json", record_json({"map_id": "hall"}))
    assert [build.build_id for build in queue.find()] == ["b1", "b2", "b3"], "once it is mended"


@pytest.fixture
def service_with_damage(service: Service) -> Service:
    catalog = waiting_builds(service.catalog.store)
    catalog.builds.set_status("b3", new_status("succeeded", map_id="hall", version="a" * 64))
    service.catalog.store.put("builds/b2/status.json", b"")
    return service


def test_it_is_listed_as_unreadable(service_with_damage: Service):
    http = service_with_damage.http
    listed = {build["build_id"]: build for build in http.get("/builds").json()["builds"]}
    assert {name: build["state"] for name, build in listed.items()} == {
        "b1": "queued",
        "b2": "unreadable",
        "b3": "succeeded",
    }
    assert listed["b2"]["map_id"] == "hall"
    assert listed["b2"]["error"]["code"] == "unreadable_record"
    (found,) = http.get("/builds?state=unreadable").json()["builds"]
    assert found == http.get("/builds/b2").json() == listed["b2"]
    assert value(service_with_damage, "firstfix_unreadable_records_total", kind="build_status") == 1
    assert http.post("/collect-garbage").status_code == 200


def test_what_cannot_be_told_is_one_problem(service_with_damage: Service):
    refused = service_with_damage.http.delete("/builds/b2")
    assert (refused.status_code, refused.json()["code"]) == (502, "unreadable_record")
