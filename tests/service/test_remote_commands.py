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
from firstfix.catalog.manifest import Manifest
from firstfix.errors import Overloaded
from tests.commands import Said, firstfix
from tests.service.service_world import Service
from tests.waiting import wait_until


def build(service: Service, source: Path, *options: object, code: int = 0) -> Said:
    return firstfix("build", source, "--map-id", "hall", "--url", service.url, *options, code=code)


def printed(said: Said) -> list[str]:
    """The lines of the command; the service of the tests logs to the same stream."""
    return [line for line in said.out.splitlines() if "[info" not in line]


def the_map(folder: Path) -> Path:
    path = folder / "map.xyz"
    path.write_bytes(b"0 0 0\n")
    return path


def ends_as(service: Service, state: str, **more: Any) -> threading.Thread:
    """Plays the builder: ends the first build with this state."""

    def end() -> None:
        wait_until(service.catalog.builds.ids)
        (build_id,) = service.catalog.builds.ids()
        service.catalog.builds.set_status(build_id, new_status(state, map_id="hall", **more))

    thread = threading.Thread(target=end)
    thread.start()
    return thread


@pytest.mark.parametrize("as_json", [True, False])
def test_a_map_is_built_by_a_service(service: Service, tmp_path: Path, as_json: bool):
    version = service.catalog.active_version("hall")
    builder = ends_as(service, "succeeded", version=version)
    options = ["--sensor", "vlp-16", "--axis", "y-up", *(["--json"] if as_json else [])]
    first = printed(build(service, the_map(tmp_path), *options))[0]
    builder.join()
    assert (json.loads(first)["version"] if as_json else first.rpartition(" ")[2]) == version
    (build_id,) = service.catalog.builds.ids()
    assert service.catalog.builds.request(build_id)["config"] == {"sensor": "vlp-16", "axis": "y-up"}


REBUILT = {
    "base": "b" * 64,
    "changed": 40,
    "gone": 2,
    "changed_since_taught": 0.03,
    "keys_of": "c" * 64,
    "calibration_of": None,
}


@pytest.mark.parametrize("rebuilt", [REBUILT, None])
def test_what_a_rebuild_has_kept_is_told(service: Service, tmp_path: Path, rebuilt: dict[str, Any] | None):
    folder = tmp_path / "version"
    folder.mkdir()
    (folder / "label.txt").write_text("7")
    manifest = Manifest.for_directory(folder, source={"rebuilt": rebuilt} if rebuilt else {})
    version = service.catalog.publish("hall", folder, manifest)
    builder = ends_as(service, "succeeded", version=version)
    said = printed(build(service, the_map(tmp_path)))
    builder.join()
    kept = "  42 templates have changed since bbbbbbbbbbbb: keys kept of version cccccccccccc, "
    assert [line for line in said if "keys kept" in line] == (
        [f"{kept}calibration taught anew"] if rebuilt else []
    )


def test_a_failed_build_is_an_error(service: Service, tmp_path: Path):
    builder = ends_as(service, "failed", error={"code": "build_failed", "detail": "no floor found"})
    assert "no floor found" in build(service, the_map(tmp_path), code=2).error
    builder.join()


def test_a_build_need_not_be_waited_for_and_a_folder_is_sent_as_an_archive(service: Service, tmp_path: Path):
    folder = tmp_path / "plant"
    folder.mkdir()
    the_map(folder)
    said = json.loads(printed(build(service, folder, "--no-wait", "--json"))[0])
    (build_id,) = service.catalog.builds.ids()
    assert said.pop("waits_for").startswith("this service runs no builds")
    assert said == {"map_id": "hall", "build_id": build_id, "state": "queued"}
    request = service.catalog.builds.request(build_id)
    assert request["file_name"] == "plant.zip"
    with ZipFile(BytesIO(service.catalog.store.get(request["source"]["key"]))) as archive:
        assert archive.namelist() == ["map.xyz"]


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (["--store", "/tmp/x"], "cannot be used with --store"),
        (["--work", "/tmp/x"], "--work needs --store"),
        (["--config", "nothere.yaml"], "nothere.yaml: no such file"),
        (["--sensor", "no-such-lidar"], "no-such-lidar"),
    ],
)
def test_options_of_another_build_are_refused(shared_service: Service, tmp_path: Path, extra, says: str):
    assert says in build(shared_service, the_map(tmp_path), *extra, code=2).error
    assert shared_service.catalog.builds.ids() == []


def odometry(folder: Path, poses: list[str]) -> Path:
    for n in range(len(poses)):
        np.save(folder / f"{n}.npy", np.random.default_rng(n).uniform(-9, 9, (300, 3)))
    rows = [f"{n}.npy,{pose}" for n, pose in enumerate(poses)]
    path = folder / "odometry.csv"
    path.write_text("\n".join(["scan,tx,ty,tz,qx,qy,qz,qw", *rows]))
    return path


@pytest.mark.parametrize("transport", ["--url", "--zenoh"])
def test_several_scans_are_one_query(shared_service: Service, tmp_path: Path, transport: str):
    way = odometry(tmp_path, ["0,0,0,0,0,0,1", "1,0,0,0,0,0,1", "2,0.5,0,0,0,0.1,0.995"])
    where = shared_service.url if transport == "--url" else shared_service.endpoint
    said = firstfix("localize", "--odometry", way, "--map", "hall", transport, where, "--json")
    x, y, _ = json.loads(printed(said)[0])["T_map_sensor"]["position"]
    assert (x, y) == (1, 3), "the map's label, and the scans of the query"


def test_odometry_has_a_pose_for_each_of_few_scans(tmp_path: Path):
    def refused(*arguments: object) -> str:
        return firstfix("localize", *arguments, "--map", "hall", "--url", "http://127.0.0.1:9", code=2).error

    assert "every scan needs its odometry pose" in refused(
        "--odometry", odometry(tmp_path, ["0,0,0,0,0,0,1", ",,,,,,"])
    )
    many = odometry(tmp_path, ["0,0,0,0,0,0,1"] * 17)
    assert "up to 16 scans" in refused("--odometry", many)
    refused(tmp_path / "0.npy", "--odometry", many)


def test_a_busy_service_is_an_error(service: Service, tmp_path: Path):
    service.behaviour.raises = Overloaded("the queue is full")
    np.save(tmp_path / "scan.npy", np.ones((300, 3)))
    arguments = ["localize", tmp_path / "scan.npy", "--map", "hall", "--url", service.url, "--timeout", 1]
    assert "the queue is full" in firstfix(*arguments, code=1).error
