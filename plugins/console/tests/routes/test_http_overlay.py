"""A scan is laid over a version over HTTP: its points come back with what the map says about each."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.catalog.manifest import Manifest
from firstfix.engine.config import ENGINE_FILE
from tests.changed_hall import Hall, pose, standing
from tests.service.service_world import XYZ, Service

HALL = Hall((16.0, 10.0, 4.0), standing((9.2, 4.2, 0.0, 10.3, 6.3, 2.3)))
AT = pose(4.1, 5.2)
POINT = np.dtype([("at", "<f4", 3), ("kind", "<u4")])
PLACE = "4.1,5.2,1,0,0,0,1"


@pytest.fixture
def version(service: Service) -> str:
    folder = service.scratch / "laid"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("7")
    (folder / ENGINE_FILE).write_text(HALL.index.config.model_dump_json())
    HALL.index.surface.save(folder)
    HALL.index.view.save(folder)
    return service.catalog.publish("hall", folder, Manifest.for_directory(folder))


def test_the_points_come_with_what_the_map_says(service: Service, version: str):
    scan = HALL.scan(HALL.simulator(), AT, np.random.default_rng(3))
    answer = service.http.post(
        f"/maps/hall/versions/{version}/overlay",
        params={"T_map_sensor": PLACE},
        content=scan.points.astype("<f4").tobytes(),
        headers={"Content-Type": XYZ},
    )
    found = np.frombuffer(answer.content, POINT)
    np.testing.assert_allclose(found["at"], scan.points, atol=1e-4)
    assert np.mean(found["kind"] == 0) > 0.98


@pytest.mark.parametrize(
    ("params", "media_type", "body", "status"),
    [
        ({}, XYZ, bytes(12), 400),
        ({"T_map_sensor": "1,2,3"}, XYZ, bytes(12), 400),
        ({"T_map_sensor": "1,2,3,0,0,0,0"}, XYZ, bytes(12), 400),
        ({"T_map_sensor": PLACE}, "image/png", bytes(12), 415),
        ({"T_map_sensor": PLACE}, XYZ, bytes(7), 400),
        ({"T_map_sensor": PLACE}, XYZ, b"", 400),
    ],
)
def test_what_cannot_be_laid_is_refused(
    service: Service, version: str, params: dict[str, str], media_type: str, body: bytes, status: int
):
    path = f"/maps/hall/versions/{version}/overlay"
    answer = service.http.post(path, params=params, content=body, headers={"Content-Type": media_type})
    assert answer.status_code == status, answer.text


def test_a_version_that_is_not_there(service: Service):
    params, headers = {"T_map_sensor": PLACE}, {"Content-Type": XYZ}
    for version in ("0" * 64, "nonsense"):
        path = f"/maps/hall/versions/{version}/overlay"
        answer = service.http.post(path, params=params, content=bytes(1200), headers=headers)
        assert answer.status_code in (400, 404)
