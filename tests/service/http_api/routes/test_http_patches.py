"""Patches of maps that are asked for over HTTP. Another process runs their builds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source, source_key
from tests.service.service_world import Service, running_service


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False, run_builds=False) as service:
        yield service


def publish_built(service: Service, patch: str) -> str:
    """Publishes a version of a recorded build, whose config says this of patches."""
    folder = service.scratch / "built"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("1")
    key = source_key("hall", put_source(service.catalog.store, "hall", folder / "label.txt"))
    request = {"map_id": "hall", "source": {"key": key}, "trajectory": None, "config": {"patch": patch}}
    service.catalog.builds.put("b1", request)
    return service.catalog.publish("hall", folder, Manifest.for_directory(folder), build_id="b1")


def test_a_patch_is_recorded_as_a_build(recorder: Service):
    version = publish_built(recorder, "activate")
    answer = recorder.http.post("/maps/hall/patch")
    assert answer.status_code == 202
    build_id = answer.json()["build_id"]
    assert answer.headers["location"] == f"/builds/{build_id}"
    assert answer.json()["state"] == "queued"
    request = recorder.catalog.builds.request(build_id)
    assert request["patch"] == {"base": version, "mode": "activate"}
    assert request["owner"]
    answer = recorder.http.post("/maps/hall/patch", params={"mode": "propose"})
    assert recorder.catalog.builds.request(answer.json()["build_id"])["patch"]["mode"] == "propose"


def test_patches_that_are_off_are_refused(recorder: Service):
    assert recorder.http.post("/maps/hall/patch").status_code == 404
    publish_built(recorder, "off")
    answer = recorder.http.post("/maps/hall/patch")
    assert answer.status_code == 409
    assert "patches of map hall are off" in answer.json()["detail"]
    assert recorder.http.post("/maps/hall/patch", params={"mode": "force"}).status_code == 400
    assert recorder.catalog.builds.ids() == ["b1"]
