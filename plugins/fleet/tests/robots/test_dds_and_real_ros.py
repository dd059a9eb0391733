"""Robots on a real ROS 2 with Fast DDS, and the gateway on Cyclone DDS, without ROS."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.ros import pose_message
from firstfix.ros.type_hashes import TYPE_HASHES
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from tests.dds_loopback import LOOPBACK
from tests.fake_service import FakeService
from tests.robots.real_robots import Network, RosRobots, ros_robots
from tests.robots.real_ros import DISTRIBUTIONS, real_ros
from tests.robots.robot_program import write_points
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow

POINTS = 100
POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
# As `ros2 topic info --verbose` shows it.
HASHES = """
import rclpy
rclpy.init()
node = rclpy.create_node("looker")
found = []
while not found:
    rclpy.spin_once(node, timeout_sec=0.05)
    found = node.get_publishers_info_by_topic("/robot1/initialpose")
print(found[0].topic_type_hash)
"""


@pytest.fixture(scope="module", params=DISTRIBUTIONS)
def network(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Network:
    return Network(real_ros(request.param), tmp_path_factory.mktemp(request.param))


@pytest.fixture(scope="module")
def robots(network: Network) -> Iterator[RosRobots]:
    with ros_robots(network.ros, network.environment) as running:
        yield running


@pytest.fixture
def service() -> Iterator[FakeService]:
    found = Localization(Verdict.LOCALIZED, (), POSE, POSE, np.eye(6), 0.99, map_id="hall")
    running = FakeService({POINTS: found})
    yield running
    running.stop()


def test_all_topics_and_requests_pass_and_that_replies_do_not_is_told(
    robots: RosRobots,
    network: Network,
    service: FakeService,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    options = ("--dds", "--domain", str(network.domain), "--imu", "imu")
    spread = np.random.default_rng(1).uniform(-9, 9, (POINTS, 3))
    robot = robots.robot("/robot1")

    def asks_with_gravity() -> bool:
        """Asks once more: the first cloud may come before the first sample of the IMU."""
        before = len(robot.of("initialpose"))
        robot.call(1)
        robot.wait_for("initialpose", before + 1)
        return "gravity" in service.queries[-1]

    with network.gateway(service.url, "hall", *options, with_ros=False) as gateway:
        robot.wait_until_known()  # a pose that is published before its topic is known is heard by nobody
        robot.show(write_points(Scan(spread), tmp_path / "points.bin"), np.eye(4))
        robot.wait_for("initialpose")
        robot.wait_for("first_fix/pose")
        robot.wait_for("tf", 2)
        wait_until(lambda: robot.says(message="localized"))
        wait_until(asks_with_gravity)
        wait_until(lambda: "cannot answer" in gateway.text)
        looker = subprocess.run(
            [network.ros.python, "-c", HASHES],
            env=network.environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=LIMIT_S,
        )
        assert looker.returncode == 0, looker.stderr
        assert looker.stdout.strip() == TYPE_HASHES[pose_message.TYPE]
        assert "get no reply" in gateway.text
    robot.go()
