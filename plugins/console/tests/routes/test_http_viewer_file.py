"""A map as a file for viewers over HTTP: what is in it, who may have it, and what is refused."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from firstfix_console import viewer_file
from plugins.console.tests.export.exported_world import ExportedWorld, make_exported_world
from plugins.console.tests.export.test_export_command import messages, points_in, rows_in
from tests.service.access_world import KEYED, bearer, known
from tests.service.query_worker_pids import Workers
from tests.service.service_world import Service, running_service
from tests.waiting import wait_until

FIELDS = ("x", "y", "z", "intensity")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Service, ExportedWorld]]:
    folder = tmp_path_factory.mktemp("served")
    with running_service(folder, zenoh=False, **KEYED) as service:
        yield service, make_exported_world(service.settings.store, folder / "drawn")


def address(world: ExportedWorld) -> str:
    return f"/maps/hall/versions/{world.version[:12]}/viewer-file"


def test_the_file_has_the_map_and_the_queries_that_were_asked_for(exported, tmp_path: Path):
    service, world = exported
    headers = bearer(known(service, "build"))
    answer = service.http.get(address(world), params={"queries": 5}, headers=headers)
    assert answer.status_code == 200, answer.text
    name = f'attachment; filename="hall-{world.version[:12]}.mcap"'
    assert answer.headers["content-disposition"] == name
    file = tmp_path / "hall.mcap"
    file.write_bytes(answer.content)
    found = messages(file)
    assert len(rows_in(found["/map"][0][1], *FIELDS)) == len(world.cloud)
    assert len(found["/answer"]) == 5
    ((_, scan),) = found["/scan"]
    np.testing.assert_array_equal(points_in(scan), world.points[world.query_ids[0]])
    assert "its points cannot be shown" in found["/log"][4][1].msg, "its body was cut off"
    fewer = service.http.get(address(world), params={"points": 1000}, headers=headers)
    file.write_bytes(fewer.content)
    found = messages(file)
    assert 0 < len(rows_in(found["/map"][0][1], *FIELDS)) <= 1000
    assert "/answer" not in found


def test_recorded_queries_are_for_those_who_may_see_them(exported):
    service, world = exported
    robot = bearer(known(service, "localize"))
    assert service.http.get(address(world), headers=robot).status_code == 200
    refused = service.http.get(address(world), params={"queries": 1}, headers=robot)
    assert refused.status_code == 403
    elsewhere = bearer(known(service, "admin", maps=("attic",)))
    assert service.http.get(address(world), headers=elsewhere).status_code == 403


def test_a_file_that_is_too_large_is_refused_with_the_way_to_it(exported, monkeypatch: pytest.MonkeyPatch):
    service, world = exported
    monkeypatch.setattr(viewer_file, "MAX_BYTES", 1000 * viewer_file.POINT_BYTES + 50)
    headers = bearer(known(service, "build"))
    answer = service.http.get(address(world), params={"queries": 5, "points": 1000}, headers=headers)
    assert answer.status_code == 413
    assert "`firstfix export hall.mcap --map hall`" in answer.json()["detail"]


def test_what_is_not_installed_is_said_with_the_remedy(exported, monkeypatch: pytest.MonkeyPatch):
    service, world = exported
    monkeypatch.setattr(viewer_file, "find_spec", lambda name: None if name == "rerun" else find_spec(name))
    headers = bearer(known(service, "localize"))
    formats = {one["format"]: one for one in service.http.get("/viewer-formats", headers=headers).json()}
    assert formats["mcap"]["remedy"] == ""
    assert "./plugins/console[rerun]" in formats["rrd"]["remedy"]
    assert "rerun opens the .mcap file, too" in formats["rrd"]["remedy"]
    answer = service.http.get(address(world), params={"format": "rrd"}, headers=headers)
    assert answer.status_code == 400
    assert "./plugins/console[rerun]" in answer.json()["detail"]


def test_recorded_bodies_are_decoded_by_a_worker_within_its_time(tmp_path: Path):
    workers = Workers()
    with running_service(tmp_path, zenoh=False, load=None, workers=1, query_timeout_s=1.5) as service:
        world = make_exported_world(service.settings.store, tmp_path / "drawn")
        ask = partial(service.http.get, address(world), params={"queries": 5, "points": 1000})
        wait_until(lambda: ask().status_code == 200)
        (stuck,) = workers.pids()
        os.kill(stuck, signal.SIGSTOP)  # a body that takes it for ever
        late = ask()
        assert (late.status_code, late.json()["code"]) == (504, "deadline_exceeded")
        wait_until(lambda: stuck not in workers.pids())
        without = service.http.get(address(world), params={"points": 1000})
        assert without.status_code == 200, "a map without queries needs no worker"
