"""The ROS 2 node of one robot on a real ROS 2: topics, parameters, time, and how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, quaternion_of, rotation_z
from tests.cpp.stored_versions import stored
from tests.fake_service import FakeService
from tests.robots.real_robots import Network, RosRobot, RosRobots, ros_robots
from tests.robots.real_ros import DISTRIBUTIONS, real_ros
from tests.robots.robot_program import T_BASE_SENSOR, write_points
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow

CLIENTS = Path(__file__).resolve().parents[2] / "clients" / "ros2"
POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
LOCALIZED, REJECTED = 100, 200
NODE = "from firstfix_ros.node import main; main()"
# What `ros2 param` and `ros2 topic info` do: their packages are not on the registry of Python.
LOOKER = """
import json, rclpy, sys, time
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rcl_interfaces.msg import Parameter, ParameterValue
rclpy.init()
node = rclpy.create_node("looker")
def call(kind, service, request):
    client = node.create_client(kind, service)
    assert client.wait_for_service(200)
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future)
    return future.result()
name = sys.argv[1]
def set_double(parameter, value):
    request = SetParameters.Request(parameters=[
        Parameter(name=parameter, value=ParameterValue(type=3, double_value=value))])
    (result,) = call(SetParameters, name + "/set_parameters", request).results
    return result.successful, result.reason
request = DescribeParameters.Request(names=["retry_s", "map_id"])
retry_s, map_id = call(DescribeParameters, name + "/describe_parameters", request).descriptors
def subscriptions():
    found = node.get_subscriptions_info_by_topic(sys.argv[2])
    return [one for one in found if one.node_name == "first_fix"]
while not subscriptions():
    time.sleep(0.05)
print(json.dumps({
    "descriptions": [retry_s.description, map_id.description],
    "range": [retry_s.floating_point_range[0].from_value, retry_s.floating_point_range[0].to_value],
    "read_only": [retry_s.read_only, map_id.read_only],
    "set watch_s": set_double("watch_s", 0.5),
    "set watch_s out of range": set_double("watch_s", -1.0),
    "set timeout_s": set_double("timeout_s", 3.0),
    "reliability": [one.qos_profile.reliability.name for one in subscriptions()],
}))
"""


@pytest.fixture(scope="module")
def service() -> Iterator[FakeService]:
    answers = {
        LOCALIZED: Localization(Verdict.LOCALIZED, (), POSE, POSE, np.eye(6), 0.99, map_id="hall"),
        REJECTED: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)),
    }
    running = FakeService(answers)
    yield running
    running.stop()


@pytest.fixture(scope="module", params=DISTRIBUTIONS)
def network(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Network:
    return Network(real_ros(request.param), tmp_path_factory.mktemp(request.param))


@pytest.fixture(scope="module")
def robots(network: Network) -> Iterator[RosRobots]:
    with ros_robots(network.ros, network.environment) as running:
        yield running


class Node:
    """A running node."""

    def __init__(self, network: Network, log: Path, arguments: list[str]) -> None:
        self._log = log
        packages = os.pathsep.join([network.environment["PYTHONPATH"], str(CLIENTS)])
        with log.open("wb") as out:
            self.process = subprocess.Popen(
                [sys.executable, "-c", NODE, "--ros-args", *arguments],
                env={**network.environment, "PYTHONPATH": packages},
                stdout=out,
                stderr=out,
            )

    @property
    def text(self) -> str:
        return self._log.read_text()

    def end(self, number: signal.Signals) -> int:
        self.process.send_signal(number)
        return self.process.wait(LIMIT_S)


@contextmanager
def node(network: Network, log: Path, *given: str, **parameters: str) -> Iterator[Node]:
    """Runs a node as long as the block lasts."""
    arguments = [*given]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={value}"]
    running = Node(network, log, arguments)
    try:
        yield running
    finally:
        running.process.kill()
        running.process.wait()


def show(robot: RosRobot, folder: Path, points: int) -> None:
    spread = np.random.default_rng(points).uniform(-9, 9, (points, 3))
    robot.show(write_points(Scan(spread), folder / f"{points}.bin"), np.eye(4))


def test_a_node_in_a_namespace_with_other_topics(
    robots: RosRobots, network: Network, service: FakeService, tmp_path: Path
):
    """Namespaced as Nav2 does it: /tf and /tf_static are remapped into the robot's namespace."""
    robot = robots.robot("/r1", points="os/points", late_s=2.0, reliable=True)
    remapped = ["-r", "__ns:=/r1", "-r", "points:=os/points", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"]
    qos = {"qos_overrides./r1/os/points.subscription.reliability": "reliable"}
    given = {"map_id": "hall", "url": service.url, "retry_s": "0.1", "voxel_m": "0.0", "use_sim_time": "true"}
    service.queries.clear()
    with node(network, tmp_path / "log", *remapped, **given, **qos) as running:
        # No clock is published: the node's time stands at 0, and it works all the same.
        show(robot, tmp_path, REJECTED)
        wait_until(lambda: robot.says(message="not localized"))
        looker = subprocess.run(
            [network.ros.python, "-c", LOOKER, "/r1/first_fix", "/r1/os/points"],
            env=network.environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=LIMIT_S,
        )
        assert looker.returncode == 0, looker.stderr
        told: dict[str, Any] = json.loads(looker.stdout)
        assert all(told["descriptions"])
        assert told["range"] == [0.0, 3600.0]
        assert told["read_only"] == [False, True]
        assert told["set watch_s"] == [True, ""]
        for refused in ("set watch_s out of range", "set timeout_s"):
            successful, reason = told[refused]
            assert not successful
            assert reason
        assert told["reliability"] == ["RELIABLE"]
        wait_until(lambda: robot.says(own_localization="unknown"))  # it watches now
        show(robot, tmp_path, LOCALIZED)
        pose = robot.wait_for("initialpose")["message"]
        assert pose["header"]["frame_id"] == "map"
        assert len(service.queries[-1]["T_base_sensor"].split(",")) == 7
        assert "gravity" in service.queries[-1]
        robot.wait_for("tf", 2)
        assert robot.of("first_fix/status")[-1]["message"]["header"]["stamp"]["sec"] == 0
        assert robot.status["hardware_id"] == "/r1"
        robot.call(1)
        assert robot.wait_for("response")["message"]["success"]
        robot.wait_for("initialpose", 2)
        assert running.end(signal.SIGINT) == 0, running.text
        assert "Traceback" not in running.text
        assert "defect" not in running.text
    robot.go()


def test_it_waits_to_be_asked_and_ends_by_sigterm(
    robots: RosRobots, network: Network, service: FakeService, tmp_path: Path
):
    robot = robots.robot("", fixed=False, tf="/tf")
    given = {"map_id": "hall", "url": service.url, "voxel_m": "0.0", "at_start": "false", "imu": "false"}
    with node(network, tmp_path / "log", **given, own_pose="true") as running:
        wait_until(lambda: robot.says(message="idle"))
        show(robot, tmp_path, LOCALIZED)
        robot.call(1)
        wait_until(lambda: robot.says(state="failed"))
        assert "no transform between the frames 'base_link' and 'os_sensor'" in robot.status["message"]
        robot.fix()
        robot.wait_for("initialpose")
        assert running.end(signal.SIGTERM) == 0, running.text
        assert "Traceback" not in running.text
    robot.go()


def test_it_localizes_without_a_service(
    robots: RosRobots, network: Network, small_version, small_scans, tmp_path: Path
):
    """The pose is the localizer's own, of the version's folder alone."""
    folder = stored(small_version.directory, tmp_path)
    scan, T_map_sensor = small_scans[0]
    robot = robots.robot("/alone")
    remapped = ["-r", "__ns:=/alone", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"]
    given = {"map_id": "yard", "localizer": "local", "version_folder": str(folder), "imu": "false"}
    with node(network, tmp_path / "log", *remapped, **given) as running:
        robot.show(write_points(scan, tmp_path / "scan.bin"), T_map_sensor)
        pose = robot.wait_for("initialpose")["message"]["pose"]["pose"]
        wait_until(lambda: robot.says(map_version=folder.name, verdict="localized"))
        options = LocalizeOptions(T_base_sensor=T_BASE_SENSOR)
        answer = Localizer(MapIndex.load(folder)).localize(Scan(scan.points), options)
        assert answer.T_map_base is not None
        told = [*pose["position"].values(), *pose["orientation"].values()]
        wanted = [*answer.T_map_base[:3, 3], *quaternion_of(answer.T_map_base)]
        np.testing.assert_allclose(told, wanted, atol=1e-12)  # the mounting came as a quaternion
        assert running.end(signal.SIGINT) == 0, running.text
        assert "Traceback" not in running.text
    robot.go()


WRONG = {
    "map_id:=''": "not a map id",
    "retry_s:=1": "the parameter retry_s is a double, such as 1.0",
    "watch_s:=-1.0": "out of range",
    "imu:=often": "the parameter imu is a bool",
    "retry_s": "Couldn't parse parameter override",
    "localizer:=here": "localizer is service or local",
}


def test_wrong_parameters_end_it_with_a_line(network: Network, tmp_path: Path):
    running = {}
    for number, wrong in enumerate(WRONG):
        given = ["-p", "map_id:=hall", "-p", wrong]
        running[wrong] = Node(network, tmp_path / f"{number}.log", given)
    for wrong, one in running.items():
        assert one.process.wait(LIMIT_S) == 2, wrong
        assert WRONG[wrong] in one.text
        assert "Traceback" not in one.text
    nowhere = ["-p", "map_id:=hall", "-p", "localizer:=local", "-p", f"version_folder:={tmp_path}"]
    without_a_version = Node(network, tmp_path / "nowhere.log", nowhere)
    assert without_a_version.process.wait(LIMIT_S) == 2
    assert "there is no version in the folder" in without_a_version.text
    assert "Traceback" not in without_a_version.text
