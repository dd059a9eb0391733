"""The cloud of a version over HTTP: its index, parts of its points, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from firstfix.catalog.manifest import Manifest
from firstfix.catalog.viewer_cloud import POINT
from firstfix_builder.index.cloud_octree import CloudOctree
from firstfix_builder.mesh.intensity import Intensity
from tests.service.service_world import Service


@pytest.fixture
def version(service: Service) -> str:
    folder = service.scratch / "drawn"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("7")
    points = np.random.default_rng(1).uniform(0, 30, (30_000, 3))
    intensity = Intensity(points[:, 0].astype(np.uint8), 0.0, 30.0)
    CloudOctree.of(points, marks={"templates": points[:5]}, intensity=intensity).save(folder)
    return service.catalog.publish("hall", folder, Manifest.for_directory(folder))


def test_the_cloud_comes_node_by_node(service: Service, version: str):
    at = f"/maps/hall/versions/{version}/cloud"
    answer = service.http.get(at)
    assert answer.headers["content-type"] == "application/json"
    assert "immutable" in answer.headers["cache-control"]
    index = answer.json()
    assert sum(node[5] for node in index["nodes"]) == index["points"] == 30_000
    file = (service.scratch / "drawn/cloud.bin").read_bytes()
    for *_, first, count in [*index["nodes"], index["marks"]["templates"]]:
        part = service.http.get(f"{at}/points", params={"first": first, "count": count})
        assert part.content == file[POINT.itemsize * first : POINT.itemsize * (first + count)]
        assert "immutable" in part.headers["cache-control"]
    bright = (service.scratch / "drawn/cloud_intensity.bin").read_bytes()
    for *_, first, count in index["nodes"]:
        part = service.http.get(f"{at}/intensity", params={"first": first, "count": count})
        assert part.content == bright[first : first + count]


def test_a_version_without_intensity_says_so(service: Service):
    folder = service.scratch / "bare"
    folder.mkdir(parents=True)
    CloudOctree.of(np.random.default_rng(1).uniform(0, 3, (100, 3))).save(folder)
    version = service.catalog.publish("hall", folder, Manifest.for_directory(folder))
    at = f"/maps/hall/versions/{version}/cloud"
    assert service.http.get(at).json()["intensity"] is None
    answer = service.http.get(f"{at}/intensity", params={"first": 0, "count": 9})
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")


@pytest.mark.parametrize(
    "asked",
    [
        {"first": 30_004, "count": 2},
        {"first": -1, "count": 2},
        {"first": 0, "count": 0},
        {"first": 0, "count": 500_001},
        {},
    ],
)
def test_points_that_are_not_there_are_refused(service: Service, version: str, asked: dict[str, int]):
    answer = service.http.get(f"/maps/hall/versions/{version}/cloud/points", params=asked)
    assert answer.status_code == 400, answer.text


def test_a_version_without_a_cloud_says_so(service: Service):
    version = service.catalog.active_version("hall")
    for end in ("", "/points?first=0&count=1"):
        answer = service.http.get(f"/maps/hall/versions/{version}/cloud{end}")
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
        assert "no cloud" in answer.json()["detail"]


def test_an_index_that_was_altered_is_not_shown(service: Service, version: str):
    key = f"maps/hall/versions/{version}/cloud.json"
    index = json.loads(service.catalog.store.get(key))
    service.catalog.store.put(key, json.dumps({**index, "edge_m": 1}).encode())
    assert service.http.get(f"/maps/hall/versions/{version}/cloud").status_code == 503
