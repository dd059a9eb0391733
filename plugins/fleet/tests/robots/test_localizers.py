"""The gateway and stand-ins of real localizers, on a real ROS 2: none misses its pose, whenever it starts."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from tests.robots.real_ros import ROOT, real_ros

pytestmark = pytest.mark.slow


def scenario(*arguments: str) -> Any:
    """Figures of a scenario."""
    real_ros("jazzy")  # or the test is skipped
    done = subprocess.run(
        [sys.executable, "-m", "plugins.fleet.tests.robots.stand_ins", "jazzy", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_localizers_that_start_late_get_the_pose_where_their_robots_are():
    figures = scenario("late-starts", "--count", "3", "--within", "4", "--seed", "5")
    assert figures["got the pose"] == 3


def test_a_gateway_that_is_started_again_gives_no_second_epoch():
    figures = scenario("restarts", "--count", "2")
    assert figures["epochs"] == 1
    assert figures["poses to the localizer"] == 1, "a localizer that follows is not set back"


def test_the_recipes_with_stand_ins_of_their_projects():
    figures = scenario("recipes")
    assert set(figures) == {"nav2", "mola", "robot_localization", "autoware"}
    assert figures["autoware"]["guesses"] >= 3
