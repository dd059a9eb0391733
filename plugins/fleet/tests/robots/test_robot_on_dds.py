"""Robots of another DDS in the real hall: each starts cold and gets its pose."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from firstfix.answer.localization import Verdict
from plugins.fleet.tests.robots import rust_robot
from plugins.fleet.tests.robots.dds_world import Scene, check_pose, gateway, pose_after, scenes
from tests.claimed import any_domain
from tests.recorded_data import HALL
from tests.robots.robot_program import Robot
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

STARTS, WITHIN_M = 20, 0.2


@pytest.fixture(scope="module")
def hall_scenes(tmp_path_factory: pytest.TempPathFactory) -> list[Scene]:
    folder = tmp_path_factory.mktemp("scenes")
    return scenes(HALL.write_queries(folder / "poses.csv"), folder, STARTS)


def test_twenty_robots_start_cold_and_get_their_pose(
    program: Path, hall_store: Path, hall_scenes: list[Scene], tmp_path: Path
):
    domain, far = any_domain(), {}
    with gateway(tmp_path, hall_store, "hall", domain):
        for number, scene in enumerate(hall_scenes):
            # One after another, each a process and a participant of its own: the last one is of no help.
            with rust_robot.rust_robot(program, f"/robot{number}", domain) as robot:
                robot.wait_until_known()
                robot.show(scene.points, scene.T_map_sensor)
                far[number] = check_pose(robot.wait_for("initialpose"), scene)
    assert len(far) == STARTS
    assert max(far.values()) < WITHIN_M, far


def test_a_robot_asks_and_is_told_what_was_found(
    program: Path, hall_store: Path, hall_scenes: list[Scene], tmp_path: Path
):
    domain = any_domain()
    with (
        gateway(tmp_path, hall_store, "hall", domain, options=["--no-at-start", "--young", "0"]),
        rust_robot.rust_robot(program, "/asker", domain, reliable_clouds=True) as robot,
    ):
        robot.wait_until_known()
        for number, scene in enumerate(hall_scenes[:3]):
            robot.show(scene.points, scene.T_map_sensor)
            assert len(robot.of("initialpose")) == number, "a pose that nobody asked for"
            begin_ns = time.time_ns()
            robot.call(number)
            assert robot.wait_for("response", number + 1)["message"]["success"]
            event = pose_after(robot, begin_ns)
            assert check_pose(event, scene) < WITHIN_M
            message = event["message"]
            wait_until(lambda of=message: of in [one["message"] for one in robot.of("first_fix/pose")])
        wait_until(lambda: _last_status(robot)["message"] == "localized")
        status = _last_status(robot)
        values = {one["key"]: one["value"] for one in status["values"]}
        assert values["verdict"] == Verdict.LOCALIZED.value
        assert status["hardware_id"] == "/asker"
        assert not robot.of("unreadable"), "its own reader did not understand a message"


def _last_status(robot: Robot) -> dict[str, Any]:
    return robot.of("first_fix/status")[-1]["message"]["status"][0]
