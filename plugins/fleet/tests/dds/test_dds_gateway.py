"""A robot on DDS in the small world: its clouds go to a running service, and its pose comes back."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store
from firstfix.transform import from_quaternion, inverse, pose_error
from firstfix_cli.local_service import LocalService, local_service
from firstfix_client import Client
from plugins.fleet.tests.dds.dds_network import RobotProgram
from plugins.fleet.tests.dds.dds_robot import T_BASE_LIDAR
from tests.claimed import any_domain
from tests.dds_loopback import LOOPBACK
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def service(small_version, tmp_path_factory) -> Iterator[LocalService]:
    root = tmp_path_factory.mktemp("yard")
    folder = small_version.directory
    Catalog(Store.open(str(root / "store"))).publish("yard", folder, Manifest.for_directory(folder))
    with local_service(root / "service", root / "store") as running:
        yield running


def test_a_robot_is_found_where_it_stands(
    service: LocalService, small_scans, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    options = LocalizeOptions(T_base_sensor=T_BASE_LIDAR)
    with Client(service.url) as client:  # some scans of the world are ambiguous
        answers = [client.localize(scan, map_id="yard", options=options) for scan, _ in small_scans]
    found = [one for one, answer in zip(small_scans, answers, strict=True) if answer.T_map_sensor is not None]
    assert len(found) >= 3
    domain = any_domain()
    robot = RobotProgram(domain, "/robot1")
    arguments = ["ros-gateway", "--dds", "--map", "yard", "--url", service.url, "--domain", str(domain)]
    gateway = subprocess.Popen(
        [sys.executable, "-m", "firstfix_cli.main", *arguments, "--base-frame", "base_link"],
        stdout=subprocess.DEVNULL,
    )
    try:
        for number, (scan, T_map_lidar) in enumerate(found[:3], 1):
            path = tmp_path / f"{number}.npy"
            np.save(path, scan.points)
            robot.tell(points=str(path))
            if number > 1:
                # The gateway has taken clouds of before, and only then is asked.
                robot.wait_for("first_fix/status", len(robot.of("first_fix/status")) + 2)
                robot.tell(call=True)
                robot.wait_for("reply", number - 1)
            pose = robot.wait_for("initialpose", number)[-1]
            T_map_base = from_quaternion(pose["pose"][:3], pose["pose"][3:])
            error_m, error_deg = pose_error(T_map_lidar @ inverse(T_BASE_LIDAR), T_map_base)
            assert error_m < 0.2, number
            assert error_deg < 2.0, number
        with httpx.stream("GET", f"{service.url}/answers/events", timeout=LIMIT_S) as told:
            seen = (line for line in told.iter_lines() if '"answer":' in line)
            robots = {json.loads(next(seen).removeprefix("data: "))["robot"] for _ in range(len(answers) + 1)}
        assert robots == {"", "/robot1"}, "the namespace names the robot to those who watch"
    finally:
        robot.stop()
        gateway.terminate()
        gateway.wait(LIMIT_S)
