"""The gateway on DDS: a robot in another process, on loopback alone."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.quality import AlignmentQuality
from firstfix.errors import InvalidOption, MalformedData
from firstfix.scan.scan import Scan
from firstfix.transform import inverse, make_transform, rotation_z
from firstfix_fleet.dds.fleet import DdsFleet
from firstfix_fleet.dds.messages import FIELDS, TYPES, body_of
from firstfix_fleet.dds.participant import Participant
from firstfix_fleet.dds.qos import reliable
from firstfix_fleet.dds.trigger_service import request_header, trigger_reply
from firstfix_ros.robot.cloud_types import LIVOX
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.topics import Output, Topics
from plugins.fleet.tests.dds.dds_network import RobotProgram
from plugins.fleet.tests.dds.dds_robot import POSE as POSE_TYPE
from plugins.fleet.tests.dds.dds_robot import T_BASE_LIDAR, T_ODOM_BASE
from tests import ros_samples
from tests.claimed import any_domain
from tests.dds_loopback import LOOPBACK
from tests.fake_service import FakeService
from tests.lidar_messages import COMPRESSED_CLOUD, compressed, livox
from tests.live_clouds import TYPE_OF
from tests.ros_samples import ROS2, cdr
from tests.waiting import LIMIT_S, wait_until

POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
COVARIANCE = 0.01 * np.eye(6)
LOCALIZED, AMBIGUOUS, REJECTED = 100, 200, 300


def hypothesis(x: float) -> Hypothesis:
    T = make_transform(np.eye(3), [x, 0, 0])
    return Hypothesis(T, AlignmentQuality(0.9, 0.9, 0, 0), 0.5, 1)


def answer_of(scan: Scan, options: LocalizeOptions) -> Localization:
    if len(scan) == LOCALIZED:
        base = None if options.T_base_sensor is None else POSE @ inverse(options.T_base_sensor)
        return Localization(Verdict.LOCALIZED, (), POSE, base, COVARIANCE, 0.99)
    if len(scan) == AMBIGUOUS:
        both = (hypothesis(1.0), hypothesis(2.0))
        return Localization(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,), hypotheses=both)
    return Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))


class Gateway:
    """A running gateway that answers by the number of points."""

    def __init__(self, domain: int, **config: Any) -> None:
        self.asked: list[tuple[int, LocalizeOptions]] = []
        self.told: list[tuple[str, str]] = []
        self.gate = threading.Event()
        self.gate.set()
        self.fleet = DdsFleet(
            Participant(domain),
            self._ask,
            GatewayConfig(**{"base_frame": "base_link", "retry_s": 0.0, **config}),
            topics=Topics(imu="imu"),
            log_line=lambda *line: self.told.append(line),
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.fleet.run, args=[self._stop], daemon=True)

    def _ask(self, scan: Scan, options: LocalizeOptions) -> Localization:
        self.asked.append((len(scan), options))
        assert self.gate.wait(LIMIT_S)
        return answer_of(scan, options)

    def __enter__(self) -> Gateway:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.gate.set()
        self._stop.set()
        self._thread.join(LIMIT_S)
        assert not self._thread.is_alive()


@pytest.fixture(autouse=True)
def on_loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)


@pytest.fixture
def domain() -> int:
    return any_domain()


@pytest.fixture
def points(tmp_path: Path) -> Any:
    """Writes so many points to a file, for the robot."""

    def write(count: int) -> str:
        path = tmp_path / f"{count}.npy"
        np.save(path, np.random.default_rng(count).uniform(-9, 9, (count, 3)))
        return str(path)

    return write


@pytest.fixture
def robots(domain: int) -> Iterator[Any]:
    running: list[RobotProgram] = []

    def start(namespace: str = "", **options: Any) -> RobotProgram:
        running.append(RobotProgram(domain, namespace, **options))
        return running[-1]

    yield start
    for robot in running:
        robot.stop()


@pytest.mark.parametrize("best_effort", [False, True])
def test_a_robot_gets_its_first_fix(robots: Any, domain: int, points: Any, best_effort: bool):
    robot = robots("/fleet/robot1", best_effort=best_effort)
    with Gateway(domain) as gateway:
        robot.tell(points=points(REJECTED))  # topics keep no order among themselves: the IMU may come last
        wait_until(lambda: any(options.gravity is not None for _, options in gateway.asked))
        robot.tell(points=points(LOCALIZED))
        pose, *_ = robot.wait_for("initialpose")
        assert gateway.fleet.robots["/fleet/robot1"].subscribers(Output.INITIAL_POSE) == 1
        own = robot.wait_for("first_fix/pose")[0]
        map_to_odom = []

        def has_tf() -> bool:
            frames = [frame for one in robot.of("tf") for frame in one["frames"]]
            map_to_odom[:] = [frame for frame in frames if frame[:2] == ["map", "odom"]]
            return bool(map_to_odom)

        wait_until(has_tf)
        wait_until(lambda: any(one["message"] == "localized" for one in robot.of("first_fix/status")))
    T = POSE @ inverse(T_BASE_LIDAR)
    assert pose["frame"] == "map"
    assert pose["stamp"] >= own["stamp"], "moved on by odometry, if it was published again"
    np.testing.assert_allclose(pose["pose"][:3], T[:3, 3], atol=1e-9)
    assert len(pose["covariance"]) == 36
    np.testing.assert_allclose(map_to_odom[0][2:5], (T @ inverse(T_ODOM_BASE))[:3, 3], atol=1e-9)
    (count, options) = gateway.asked[-1]
    assert count == LOCALIZED
    np.testing.assert_allclose(options.gravity, [0, 0, -1], atol=1e-9)
    np.testing.assert_allclose(options.T_base_sensor, T_BASE_LIDAR, atol=1e-9)
    status = robot.of("first_fix/status")[-1]
    assert (status["level"], status["hardware_id"]) == (0, "/fleet/robot1")
    assert ("/fleet/robot1", "localized") in gateway.told


@pytest.mark.parametrize("form", ["zstd", "livox"])
def test_clouds_that_are_no_pointcloud2_are_told_by_discovery(
    robots: Any, domain: int, points: Any, form: str
):
    plain, other = robots("/plain"), robots("/other", form=form)
    with Gateway(domain) as gateway:
        for robot in (plain, other):
            robot.tell(points=points(LOCALIZED))
            robot.wait_for("initialpose")
        assert gateway.fleet.robots["/other"].cloud_type == TYPE_OF[form]
        assert gateway.fleet.robots["/plain"].cloud_type == TYPE_OF["plain"]
    assert {count for count, _ in gateway.asked} == {LOCALIZED}


def test_a_localizer_that_subscribes_late_gets_the_pose(robots: Any, domain: int, points: Any):
    robot = robots("/robot1")
    with Gateway(domain, repeat_s=0.1, young_s=0.0) as gateway:
        robot.tell(points=points(LOCALIZED))
        wait_until(lambda: ("/robot1", "localized") in gateway.told)
        participant = DomainParticipant(domain)
        topic = Topic(participant, "rt/robot1/initialpose", TYPES[POSE_TYPE])
        reader = DataReader(participant, topic, reliable(1))
        heard: list[Any] = []
        wait_until(lambda: heard.extend(reader.take()) or heard)
    assert ROS2.deserialize_cdr(body_of(heard[0]), POSE_TYPE).header.frame_id == "map"


def test_the_service_is_answered_and_asks_anew(robots: Any, domain: int, points: Any):
    robot = robots()
    with Gateway(domain, at_start=False) as gateway:
        robot.tell(points=points(LOCALIZED))
        wait_until(lambda: ("", "idle") in gateway.told)
        for number in (1, 2):
            robot.tell(call=True)
            reply = robot.wait_for("reply", number)[-1]
            assert (reply["mine"], reply["number"]) == (True, number)
            assert "searching" in reply["message"]
            robot.wait_for("initialpose", number)
        robot.tell(call=False)  # as a client of another implementation
        robot.wait_for("initialpose", 3)
        assert any("cannot answer" in line for _, line in gateway.told)
        assert len(robot.of("reply")) == 2


def test_hypotheses_and_a_broken_cloud(robots: Any, domain: int, points: Any):
    robot = robots("/robot1")
    with Gateway(domain, base_frame="") as gateway:
        robot.tell(points=points(AMBIGUOUS))
        shown = robot.wait_for("first_fix/hypotheses")[0]
        assert [pose[0] for pose in shown["poses"]] == [1.0, 2.0]
        robot.tell(broken=True)
        robot.tell(points=points(REJECTED))
        robot.tell(call=True)
        robot.wait_for("reply")
        asked = len(gateway.asked)
        robot.tell(points=points(LOCALIZED), broken=False)
        robot.wait_for("initialpose")
        assert len(gateway.asked) > asked


def test_clouds_that_come_while_it_asks_do_not_queue(robots: Any, domain: int, points: Any):
    robot = robots()
    with Gateway(domain) as gateway:
        gateway.gate.clear()
        robot.tell(points=points(REJECTED))
        wait_until(lambda: gateway.asked)
        statuses = len(robot.of("first_fix/status"))
        robot.tell(points=points(AMBIGUOUS))
        robot.wait_for("first_fix/status", statuses + 2)  # a second and more: twenty clouds
        robot.tell(points=points(LOCALIZED))
        robot.tell(call=True)
        robot.wait_for("reply")  # the gateway is not blocked
        wait_until(lambda: len(robot.of("first_fix/status")) > statuses + 3)
        gateway.gate.set()
        robot.wait_for("initialpose")
    assert len([count for count, _ in gateway.asked if count == AMBIGUOUS]) <= 1


def test_each_robot_gets_its_own_and_may_go(robots: Any, domain: int, points: Any):
    first, second = robots("/robot1"), robots("/robot2")
    with Gateway(domain) as gateway:
        second.tell(points=points(LOCALIZED))
        second.wait_for("initialpose")
        wait_until(lambda: sorted(gateway.fleet.robots) == ["/robot1", "/robot2"])
        assert not first.of("initialpose")
        first.stop()
        wait_until(lambda: ("/robot1", "gone") in gateway.told)
        assert sorted(gateway.fleet.robots) == ["/robot2"]


def test_the_command(robots: Any, domain: int, points: Any):
    service = FakeService(
        {LOCALIZED: Localization(Verdict.LOCALIZED, (), POSE, POSE, COVARIANCE, 0.99, map_id="hall")}
    )
    robot = robots("/robot1")
    arguments = ["ros-gateway", "--dds", "--map", "hall", "--url", service.url, "--domain", str(domain)]
    program = subprocess.Popen(
        [sys.executable, "-u", "-m", "firstfix_cli.main", *arguments, "--base-frame", "base_link"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        robot.tell(points=points(LOCALIZED))
        robot.wait_for("initialpose")
        program.send_signal(signal.SIGTERM)
        out, _ = program.communicate(timeout=LIMIT_S)
    finally:
        program.kill()
        service.stop()
    assert program.returncode == 0
    assert out.splitlines()[0] == f"looking for robots on DDS, domain {domain}"
    assert "get no reply" in out.splitlines()[1]
    assert "/robot1  localized" in out


def test_a_domain_that_cannot_be(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(
        "CYCLONEDDS_URI", "<CycloneDDS><Domain><General><Nonsense/></General></Domain></CycloneDDS>"
    )
    with pytest.raises(InvalidOption, match="cannot join the DDS domain"):
        Participant(any_domain())


def test_types_have_the_names_and_bytes_of_ros():
    """The fields that DDS is told give the bytes that rosbags writes."""
    of_ros = {
        "sensor_msgs/msg/PointCloud2": ros_samples.cloud_of_points(np.ones((3, 3))),
        "sensor_msgs/msg/Imu": ros_samples.imu([1.0, 2.0, 3.0], stamp_ns=5),
        "tf2_msgs/msg/TFMessage": ros_samples.transforms([("a", "b", POSE), ("b", "cc", POSE)]),
    }
    types = ROS2.types
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](1.0, 2.0, 3.0),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8),
    )
    header = ros_samples.header(ROS2, 7, "map")
    uncertain = types["geometry_msgs/msg/PoseWithCovariance"](pose, np.arange(36.0))
    name = "geometry_msgs/msg/PoseWithCovarianceStamped"
    of_ros[name] = types[name](header, uncertain)
    of_ros["geometry_msgs/msg/PoseArray"] = types["geometry_msgs/msg/PoseArray"](header, [pose, pose])
    value = types["diagnostic_msgs/msg/KeyValue"]("key", "v")
    one = types["diagnostic_msgs/msg/DiagnosticStatus"](2, "n", "message", "", [value, value])
    of_ros["diagnostic_msgs/msg/DiagnosticArray"] = types["diagnostic_msgs/msg/DiagnosticArray"](
        header, [one]
    )
    of_ros[COMPRESSED_CLOUD] = compressed(of_ros["sensor_msgs/msg/PointCloud2"], "zlib", b"packed")
    rows = np.ones(3, [("t", "u4"), *((axis, "f4") for axis in "xyz"), ("i", "u1"), ("g", "u1"), ("l", "u1")])
    for ros_type in LIVOX:
        of_ros[ros_type] = livox(rows, ros_type.partition("/")[0])
    assert set(of_ros) == {name for name in FIELDS if "/msg/" in name}
    for ros_type, message in of_ros.items():
        body = cdr(message)
        kind = TYPES[ros_type]
        package, _, short = ros_type.split("/")
        assert kind.__idl_typename__ == f"{package}::msg::dds_::{short}_"
        assert not math.isnan(len(body))
        read = kind.__idl__.deserialize(body)
        assert kind.__idl__.serialize(read, use_version_2=False) == body, ros_type


def test_requests_of_each_implementation():
    header = (0x1122334455667788).to_bytes(8, "little") + (41).to_bytes(8, "little")
    assert request_header(b"\0\1\0\0" + header + b"\0" + bytes(3)) == (0x1122334455667788, 41)
    assert request_header(b"\0\1\0\0" + bytes(4)) is None
    assert trigger_reply((0x1122334455667788, 41), "oh")[4:] == header + b"\1\0\0\0\3\0\0\0oh\0"
    for broken in (b"", b"\0\1\0\0", b"\0\1\0\0" + bytes(40)):
        with pytest.raises(MalformedData):
            request_header(broken)
