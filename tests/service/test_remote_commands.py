"""Command line against a running service: builds, several scans, and exit codes."""

from __future__ import annotations

import json
import threading
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from firstfix.builds.records import new_status
from firstfix.errors import Overloaded
from firstfix_cli.main import run
from tests.service.service_world import Service
from tests.waiting import wait_until


def ended(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


def printed(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Returns the lines of the command line; the service of the tests logs to the same stream."""
    return [line for line in capsys.readouterr().out.splitlines() if "[info" not in line]


def the_map(folder: Path) -> Path:
    path = folder / "map.xyz"
    path.write_bytes(b"0 0 0\n")
    return path


def ends_as(service: Service, state: str, **more: Any) -> threading.Thread:
    """Plays the builder: ends the first build with this state."""

    def build() -> None:
        wait_until(service.catalog.builds.ids)
        (build_id,) = service.catalog.builds.ids()
        service.catalog.builds.set_status(build_id, new_status(state, map_id="hall", **more))

    thread = threading.Thread(target=build)
    thread.start()
    return thread


@pytest.mark.parametrize("as_json", [True, False])
def test_a_service_builds(service: Service, tmp_path: Path, capsys, as_json: bool):
    version = service.catalog.active_version("hall")
    builder = ends_as(service, "succeeded", version=version)
    options = ["--sensor", "vlp-16", "--axis", "y-up", *(["--json"] if as_json else [])]
    assert ended("build", the_map(tmp_path), "--map-id", "hall", "--url", service.url, *options) == 0
    builder.join()
    first = printed(capsys)[0]
    assert (json.loads(first)["version"] if as_json else first.rpartition(" ")[2]) == version
    (build_id,) = service.catalog.builds.ids()
    assert service.catalog.builds.request(build_id)["config"] == {"sensor": "vlp-16", "axis": "y-up"}


def test_a_build_that_fails_is_an_error(service: Service, tmp_path: Path, capsys):
    failure = {"code": "build_failed", "detail": "no floor found"}
    builder = ends_as(service, "failed", error=failure)
    assert ended("build", the_map(tmp_path), "--map-id", "hall", "--url", service.url) == 2
    builder.join()
    assert "no floor found" in capsys.readouterr().err


def test_a_build_need_not_be_waited_for(service: Service, tmp_path: Path, capsys):
    arguments = ["build", the_map(tmp_path), "--map-id", "hall", "--url", service.url, "--no-wait", "--json"]
    assert ended(*arguments) == 0
    said = json.loads(printed(capsys)[0])
    assert said.pop("waits_for").startswith("this service runs no builds")
    assert said == {"map_id": "hall", "build_id": service.catalog.builds.ids()[0], "state": "queued"}


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (["--store", "/tmp/x"], "cannot be used with --store"),
        (["--work", "/tmp/x"], "--work needs --store"),
        (["--config", "nothere.yaml"], "nothere.yaml: no such file"),
        (["--sensor", "no-such-lidar"], "no-such-lidar"),
    ],
)
def test_what_a_remote_build_cannot_take(service: Service, tmp_path: Path, capsys, extra, says):
    assert ended("build", the_map(tmp_path), "--map-id", "hall", "--url", service.url, *extra) == 2
    assert says in capsys.readouterr().err
    assert service.catalog.builds.ids() == []


def test_a_folder_goes_as_an_archive(service: Service, tmp_path: Path):
    folder = tmp_path / "plant"
    folder.mkdir()
    the_map(folder)
    assert ended("build", folder, "--map-id", "hall", "--url", service.url, "--no-wait") == 0
    (build_id,) = service.catalog.builds.ids()
    request = service.catalog.builds.request(build_id)
    assert request["file_name"] == "plant.zip"
    with ZipFile(BytesIO(service.catalog.store.get(request["source"]["key"]))) as archive:
        assert archive.namelist() == ["map.xyz"]


def odometry(folder: Path, poses: list[str]) -> Path:
    for n in range(len(poses)):
        np.save(folder / f"{n}.npy", np.random.default_rng(n).uniform(-9, 9, (300, 3)))
    rows = [f"{n}.npy,{pose}" for n, pose in enumerate(poses)]
    path = folder / "odometry.csv"
    path.write_text("\n".join(["scan,tx,ty,tz,qx,qy,qz,qw", *rows]))
    return path


@pytest.mark.parametrize("transport", ["--url", "--zenoh"])
def test_several_scans_are_one_query(service: Service, tmp_path: Path, capsys, transport: str):
    way = odometry(tmp_path, ["0,0,0,0,0,0,1", "1,0,0,0,0,0,1", "2,0.5,0,0,0,0.1,0.995"])
    where = service.url if transport == "--url" else service.endpoint
    assert ended("localize", "--odometry", way, "--map", "hall", transport, where, "--json") == 0
    x, y, _ = json.loads(printed(capsys)[0])["T_map_sensor"]["position"]
    assert (x, y) == (1, 3), "the map's label, and the scans of the query"


def test_odometry_has_a_pose_for_each_of_few_scans(service: Service, tmp_path: Path, capsys):
    arguments = ["--map", "hall", "--url", service.url]
    assert ended("localize", "--odometry", odometry(tmp_path, ["0,0,0,0,0,0,1", ",,,,,,"]), *arguments) == 2
    assert "every scan needs its odometry pose" in capsys.readouterr().err
    many = odometry(tmp_path, ["0,0,0,0,0,0,1"] * 17)
    assert ended("localize", "--odometry", many, *arguments) == 2
    assert "up to 16 scans" in capsys.readouterr().err
    assert ended("localize", tmp_path / "0.npy", "--odometry", many, *arguments) == 2


def test_a_service_that_is_busy_is_no_answer(service: Service, tmp_path: Path, capsys):
    service.behaviour.raises = Overloaded("the queue is full")
    np.save(tmp_path / "scan.npy", np.ones((300, 3)))
    arguments = ["localize", tmp_path / "scan.npy", "--map", "hall", "--url", service.url, "--timeout", 1]
    assert ended(*arguments) == 1
    assert "the queue is full" in capsys.readouterr().err
