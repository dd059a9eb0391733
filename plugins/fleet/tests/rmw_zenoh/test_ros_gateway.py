"""The gateway with zenoh sessions that act as rmw_zenoh robots."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import zenoh
import zenoh.ext

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.ros import imu, point_cloud2, pose_message, tf_message
from firstfix.ros.cdr import MessageReader
from firstfix.ros.rmw_zenoh import (
    PUBLISHER,
    RELIABLE_QOS,
    SENSOR_QOS,
    SERVICE,
    SUBSCRIPTION,
    Attachment,
    Node,
    dds_type,
    endpoint,
    parse_token,
)
from firstfix.ros.type_hashes import TRIGGER
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix_fleet.rmw_zenoh.fleet import RosGateway, open_session
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.topics import Output, Topics
from tests.fake_service import FakeService
from tests.live_clouds import TYPE_OF, live_cloud
from tests.ros_samples import ROS2, cdr, transforms
from tests.ros_samples import imu as imu_message
from tests.servers import free_port
from tests.waiting import LIMIT_S, wait_until

POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
FOUND = Localization(Verdict.LOCALIZED, (), POSE, None, np.eye(6), 0.99)
REJECTED = Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))
GID = bytes(range(16))


@pytest.fixture
def router() -> Iterator[str]:
    address = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([address]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config):
        yield address


class Robot:
    """A robot as rmw_zenoh shows it: publishes clouds, records poses, calls the service."""

    def __init__(
        self, router: str, namespace: str, *, domain: int = 0, humble: bool = False, form: str = "plain"
    ) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([router]))
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("timestamping/enabled", "true")  # as in rmw_zenoh's own configuration
        self.session = zenoh.open(config)
        node = Node(domain, str(self.session.info.zid()), "lidar_driver")
        self.form = form
        self.clouds = endpoint(domain, PUBLISHER, f"{namespace}/points", point_cloud2.TYPE, humble=humble)
        if form != "plain":
            self.clouds = replace(self.clouds, dds_type=dds_type(TYPE_OF[form]), type_hash=f"RIHS01_{0:064}")
        pose = endpoint(domain, PUBLISHER, f"{namespace}/initialpose", pose_message.TYPE, humble=humble)
        self.locate = endpoint(domain, SERVICE, f"{namespace}/first_fix/relocalize", TRIGGER, humble=humble)
        self.poses: list[tuple[Any, Attachment]] = []
        self.session.declare_subscriber(pose.key, self._on_pose)
        self.publisher = self.session.declare_publisher(self.clouds.key)
        self.imu = self._publisher(f"{namespace}/imu", imu.TYPE, humble)
        frames = endpoint(domain, PUBLISHER, f"{namespace}/tf_static", tf_message.TYPE, humble=humble)
        self.frames = zenoh.ext.declare_advanced_publisher(
            self.session, frames.key, cache=zenoh.ext.CacheConfig(1), publisher_detection=True
        )
        self.token = self.session.liveliness().declare_token(node.endpoint_token(1, self.clouds, SENSOR_QOS))
        self._sequence = itertools.count(1)

    def _publisher(self, topic: str, ros_type: str, humble: bool) -> Any:
        return self.session.declare_publisher(endpoint(0, PUBLISHER, topic, ros_type, humble=humble).key)

    def _on_pose(self, sample: Any) -> None:
        message = ROS2.deserialize_cdr(sample.payload.to_bytes(), pose_message.TYPE)
        self.poses.append((message, Attachment.from_bytes(sample.attachment.to_bytes())))

    def publish(self, points: int) -> None:
        body = live_cloud(self.form, np.ones((points, 3)), 7 * 10**9, "lidar")
        attachment = Attachment(next(self._sequence), time.time_ns(), GID)
        self.publisher.put(body, attachment=attachment.to_bytes())

    @property
    def is_heard(self) -> bool:
        return bool(self.publisher.matching_status.matching)

    def call(self) -> tuple[bool, str, Attachment]:
        attachment = Attachment(41, time.time_ns(), GID).to_bytes()
        replies = self.session.get(
            self.locate.key,
            payload=b"\0\1\0\0\0",
            attachment=attachment,
            target=zenoh.QueryTarget.ALL_COMPLETE,
        )
        (reply,) = (reply.ok for reply in replies)
        read = MessageReader("Trigger", reply.payload.to_bytes())
        answer = read.flag(), read.text()
        read.end()
        return *answer, Attachment.from_bytes(reply.attachment.to_bytes())


class Gateway:
    """A running gateway with answers by point count."""

    def __init__(self, router: str, *, topics: Topics | None = None, **config: Any) -> None:
        self.asked: list[int] = []
        self.options: list[LocalizeOptions] = []
        self.told: list[tuple[str, str]] = []
        self.session = open_session(router)
        self.gateway = RosGateway(
            self.session,
            self._ask,
            GatewayConfig(retry_s=0.0, **config),
            topics=topics,
            log_line=lambda *line: self.told.append(line),
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.gateway.run, args=[self._stop], daemon=True)

    def _ask(self, scan: Scan, options: LocalizeOptions) -> Localization:
        self.asked.append(len(scan))
        self.options.append(options)
        return FOUND if len(scan) == 100 else REJECTED

    def __enter__(self) -> Gateway:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(LIMIT_S)
        assert not self._thread.is_alive()
        self.session.close()


@pytest.mark.parametrize("namespace", ["", "/fleet/robot1"])
@pytest.mark.parametrize("humble", [False, True])
def test_a_robot_gets_its_first_fix_and_then_rest(router: str, namespace: str, humble: bool):
    robot = Robot(router, namespace, humble=humble)
    with Gateway(router) as gateway:
        wait_until(lambda: robot.is_heard)
        robot.publish(50)
        wait_until(lambda: (namespace, "not localized") in gateway.told)
        robot.publish(100)
        wait_until(lambda: robot.poses)
        wait_until(lambda: not robot.is_heard)
    ((message, attachment),) = robot.poses
    assert (message.header.frame_id, message.header.stamp.sec) == ("map", 7)
    assert message.pose.pose.position.x == 12
    assert attachment.sequence == 1
    assert abs(attachment.stamp_ns - time.time_ns()) < 60e9
    assert gateway.asked == [50, 100]
    robot.session.close()


@pytest.mark.parametrize("form", ["zstd", "livox"])
def test_clouds_that_are_no_pointcloud2_are_told_by_discovery(router: str, form: str):
    plain, other = Robot(router, "/plain"), Robot(router, "/other", form=form)
    with Gateway(router) as gateway:
        for robot in (plain, other):
            wait_until(lambda of=robot: of.is_heard)
            robot.publish(100)
            wait_until(lambda of=robot: of.poses)
    assert gateway.asked == [100, 100]
    for robot in (plain, other):
        robot.session.close()


def test_a_localizer_that_subscribes_late_gets_the_pose(router: str):
    robot = Robot(router, "/robot1")
    with Gateway(router, repeat_s=0.1, young_s=LIMIT_S) as gateway:
        wait_until(lambda: robot.is_heard)
        robot.publish(100)
        wait_until(lambda: ("/robot1", "localized") in gateway.told)
        wait_until(lambda: robot.poses)
        before = len(robot.poses)
        pose = endpoint(0, SUBSCRIPTION, "/robot1/initialpose", pose_message.TYPE)
        node = Node(0, str(robot.session.info.zid()), "amcl")
        token = robot.session.liveliness().declare_token(node.endpoint_token(2, pose, RELIABLE_QOS))
        wait_until(lambda: len(robot.poses) > before)
        token.undeclare()
    robot.session.close()


@pytest.mark.parametrize("humble", [False, True])
def test_gravity_is_the_imus_and_the_mounting_that_of_the_frames(router: str, humble: bool):
    robot = Robot(router, "/robot1", humble=humble)
    T_sensor_imu = make_transform(rotation_z(np.pi / 2), [0.1, 0, 0])
    T_base_sensor = make_transform(rotation_z(0.3), [0, 0, 1.2])
    mounted = transforms([("base_link", "lidar", T_base_sensor), ("lidar", "imu", T_sensor_imu)])
    robot.frames.put(cdr(mounted))  # long before anybody subscribes
    with Gateway(router, base_frame="base_link", topics=Topics(imu="imu")) as gateway:
        wait_until(lambda: robot.is_heard and robot.imu.matching_status.matching)
        robot.imu.put(b"no IMU")
        robot.imu.put(b"no IMU")
        wait_until(lambda: any("Imu" in line for _, line in gateway.told))
        robot.imu.put(cdr(imu_message([9.81, 0, 0], stamp_ns=7 * 10**9)))

        def has_gravity() -> bool:  # zenoh keeps no order between two topics
            robot.publish(50)
            return bool(gateway.options) and gateway.options[-1].gravity is not None

        wait_until(has_gravity)
        robot.publish(100)
        wait_until(lambda: robot.poses)
    assert len([line for _, line in gateway.told if "Imu" in line]) == 1
    np.testing.assert_allclose(gateway.options[-1].T_base_sensor, T_base_sensor, atol=1e-9)
    np.testing.assert_allclose(gateway.options[-1].gravity, [0, -1, 0], atol=1e-9)
    robot.session.close()


def test_without_the_frames_no_pose_stands_for_the_base(router: str):
    robot = Robot(router, "/robot1")
    with Gateway(router, base_frame="base_link") as gateway:
        wait_until(lambda: robot.is_heard)
        robot.publish(100)
        wait_until(lambda: any("no transform between" in line for _, line in gateway.told))
    assert not gateway.asked
    assert not robot.poses
    robot.session.close()


def test_the_service_asks_for_another(router: str):
    robot = Robot(router, "/robot1")
    with Gateway(router, at_start=False) as gateway:
        wait_until(lambda: ("/robot1", "idle") in gateway.told)
        assert not robot.is_heard
        for number in (1, 2):
            success, message, attachment = robot.call()
            assert success
            assert "searching" in message
            assert (attachment.sequence, attachment.gid) == (41, GID)
            wait_until(lambda: robot.is_heard)
            robot.publish(100)
            wait_until(lambda number=number: len(robot.poses) == number)
            wait_until(lambda: not robot.is_heard)
    assert [attachment.sequence for _, attachment in robot.poses] == [1, 2]
    assert len({attachment.gid for _, attachment in robot.poses}) == 1
    robot.session.close()


def test_each_robot_gets_its_own(router: str):
    robots = [Robot(router, f"/robot{number}") for number in range(3)]
    stranger = Robot(router, "/robot9", domain=7)
    with Gateway(router) as gateway:
        wait_until(lambda: all(robot.is_heard for robot in robots))
        for robot in robots[1:]:
            robot.publish(100)
        wait_until(lambda: all(robot.poses for robot in robots[1:]))
        assert not robots[0].poses
        robots[1].token.undeclare()
        wait_until(lambda: ("/robot1", "gone") in gateway.told)
        assert sorted(gateway.gateway.robots) == ["/robot0", "/robot2"]
        assert not stranger.is_heard
    for robot in (*robots, stranger):
        robot.session.close()


def test_it_shows_in_the_graph_and_leaves_nothing_behind(router: str):
    robot = Robot(router, "/robot1")
    watcher = open_session(router)

    def ours() -> set[tuple[str, str]]:
        replies = watcher.liveliness().get("@ros2_lv/0/**", timeout=5)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        found = [parse_token(key) for key in keys if "/firstfix_gateway" in key]
        return {("", "NN") if one is None else (one.topic, one.kind) for one in found}

    with Gateway(router):
        wait_until(
            lambda: (
                ours()
                == {
                    ("", "NN"),
                    ("/robot1/points", "MS"),
                    ("/robot1/tf", "MS"),
                    ("/robot1/tf_static", "MS"),
                    ("/robot1/initialpose", "MP"),
                    ("/robot1/tf", "MP"),
                    ("/robot1/first_fix/pose", "MP"),
                    ("/robot1/first_fix/status", "MP"),
                    ("/robot1/first_fix/hypotheses", "MP"),
                    ("/robot1/first_fix/relocalize", "SS"),
                }
            )
        )
    wait_until(lambda: not ours())
    watcher.close()
    robot.session.close()


def test_it_counts_who_hears_its_poses(router: str):
    robot = Robot(router, "/robot1")
    pose = endpoint(0, SUBSCRIPTION, "/robot1/initialpose", pose_message.TYPE)
    elsewhere = endpoint(0, SUBSCRIPTION, "/robot2/initialpose", pose_message.TYPE)
    node = Node(0, str(robot.session.info.zid()), "localizer")
    liveliness = robot.session.liveliness()
    with Gateway(router) as gateway:
        wait_until(lambda: "/robot1" in gateway.gateway.robots)
        served = gateway.gateway.robots["/robot1"]
        assert served.subscribers(Output.INITIAL_POSE) == 0
        others = liveliness.declare_token(node.endpoint_token(2, elsewhere, SENSOR_QOS))
        token = liveliness.declare_token(node.endpoint_token(3, pose, SENSOR_QOS))
        wait_until(lambda: served.subscribers(Output.INITIAL_POSE) == 1)
        token.undeclare()
        wait_until(lambda: served.subscribers(Output.INITIAL_POSE) == 0)
        others.undeclare()
    robot.session.close()


def test_a_call_without_an_attachment_is_nobodys(router: str):
    robot = Robot(router, "/robot1")
    with Gateway(router, at_start=False) as gateway:
        wait_until(lambda: ("/robot1", "idle") in gateway.told)
        assert list(robot.session.get(robot.locate.key, timeout=5)) == []
        assert not gateway.gateway.robots["/robot1"].gateway.wanted
    robot.session.close()


def test_without_a_ros_it_says_how_to_go_on():
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "firstfix_cli.main",
            "ros-gateway",
            "--map",
            "hall",
            "--url",
            "http://127.0.0.1:9",
        ],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "no ROS 2 for this Python" in done.stderr
    assert all(way in done.stderr for way in ("setup.sh", "--dds", "--connect"))
    assert "Traceback" not in done.stderr


def test_the_command(router: str):
    service = FakeService({100: FOUND})
    robot = Robot(router, "/robot1")
    arguments = ["ros-gateway", "--map", "hall", "--connect", router, "--url", service.url]
    program = subprocess.Popen(
        [sys.executable, "-u", "-m", "firstfix_cli.main", *arguments], stdout=subprocess.PIPE, text=True
    )
    try:
        wait_until(lambda: robot.is_heard)
        robot.publish(100)
        wait_until(lambda: robot.poses)
        program.send_signal(signal.SIGTERM)
        out, _ = program.communicate(timeout=LIMIT_S)
    finally:
        program.kill()
        service.stop()
    assert program.returncode == 0
    assert out.splitlines()[0].startswith("looking for robots at tcp/127.0.0.1")
    assert "/robot1  localized" in out
    robot.session.close()
