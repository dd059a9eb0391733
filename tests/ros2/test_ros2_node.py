"""The ROS node with stand-ins for rclpy, against a service on loopback."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fake_ros import Graph, install

import ros_samples
from fake_service import FakeService
from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.ros.pose_message import TYPE
from firstfix.transform import make_transform, rotation_z
from ros_samples import ROS2, cdr, cloud_of_points
from waiting import wait_until

POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
LOCALIZED, REJECTED = 100, 200
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


@pytest.fixture
def service() -> Iterator[FakeService]:
    answers = {
        LOCALIZED: Localization(Verdict.LOCALIZED, (), POSE, POSE, np.eye(6), 0.99, map_id="hall"),
        REJECTED: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)),
    }
    running = FakeService(answers)
    yield running
    running.stop()


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch, service: FakeService) -> Graph:
    made = Graph()
    made.parameters = {"map_id": "hall", "url": service.url, "retry_s": 0.0, "voxel_m": 0.0}
    install(monkeypatch, made)
    return made


@pytest.fixture
def node(graph: Graph) -> Iterator[Any]:
    from firstfix_ros.node import FirstFixNode

    running = FirstFixNode()
    yield running
    running.destroy_node()
    assert graph.log[-1] == "destroyed"


def cloud(points: int) -> bytes:
    spread = np.random.default_rng(points).uniform(-9, 9, (points, 3))
    return cdr(cloud_of_points(spread, stamp_ns=7 * 10**9))


def diagnosis(graph: Graph) -> tuple[int, str, dict[str, str]]:
    (tick,) = graph.timers
    tick()
    (status,) = ROS2.deserialize_cdr(graph.published["~/status"][-1], DIAGNOSTICS).status
    return status.level, status.message, {value.key: value.value for value in status.values}


def mount(graph: Graph) -> None:
    mounted = make_transform(np.eye(3), [0.5, 0, 1])
    frames = ros_samples.transforms([("base_link", "os_sensor", mounted)])
    graph.subscriptions["/tf_static"][1](cdr(frames))


def test_a_cloud_becomes_an_initial_pose(node: Any, graph: Graph, service: FakeService):
    kind, on_cloud, qos = graph.subscriptions["points"]
    assert (kind.__name__, qos) == ("PointCloud2", "sensor data")
    assert graph.subscriptions["/tf_static"][2]["durability"] == "transient local"
    mount(graph)
    resting = ros_samples.imu([0, 0, 9.81], stamp_ns=7 * 10**9, frame_id="os_sensor")
    graph.subscriptions["imu"][1](cdr(resting))
    on_cloud(cloud(REJECTED))
    wait_until(lambda: diagnosis(graph)[1] == "not localized")
    assert diagnosis(graph)[0] == 1
    on_cloud(cloud(LOCALIZED))
    wait_until(lambda: graph.published["initialpose"])
    pose = ROS2.deserialize_cdr(graph.published["initialpose"][0], TYPE)
    assert (pose.header.frame_id, pose.header.stamp.sec, pose.pose.pose.position.x) == ("map", 7, 12)
    assert service.queries[1]["T_base_sensor"] == "0.5,0.0,1.0,0.0,0.0,0.0,1.0"
    np.testing.assert_allclose([float(v) for v in service.queries[1]["gravity"].split(",")], [0, 0, -1])
    wait_until(lambda: diagnosis(graph)[1] == "localized")
    assert graph.published["~/pose"] == graph.published["initialpose"]
    level, _, values = diagnosis(graph)
    assert (level, values["verdict"], values["map_id"]) == (0, "localized", "hall")


def test_it_rests_until_it_is_asked_again(node: Any, graph: Graph, service: FakeService):
    on_cloud = graph.subscriptions["points"][1]
    mount(graph)
    on_cloud(cloud(LOCALIZED))
    wait_until(lambda: diagnosis(graph)[1] == "localized")
    on_cloud(cloud(LOCALIZED))
    response = graph.services["~/relocalize"](None, SimpleNamespace())
    assert response.success
    on_cloud(cloud(LOCALIZED))
    wait_until(lambda: len(graph.published["initialpose"]) == 2)
    assert len(service.scans) == 2


def test_without_the_mounting_nothing_is_asked(node: Any, graph: Graph, service: FakeService):
    graph.subscriptions["points"][1](cloud(LOCALIZED))
    wait_until(lambda: diagnosis(graph)[0] == 2)
    assert "no transform between the frames 'base_link' and 'os_sensor'" in diagnosis(graph)[1]
    assert not service.scans


def test_an_imu_that_is_none_is_told(node: Any, graph: Graph):
    graph.subscriptions["imu"][1](b"x")
    assert graph.log == ["Imu: 1 bytes are too few for a message"]


def test_it_can_wait_to_be_asked_and_go_without_an_imu(graph: Graph, service: FakeService):
    from firstfix_ros.node import FirstFixNode

    graph.parameters |= {"at_start": False, "imu": False, "own_pose": True}
    node = FirstFixNode()
    assert sorted(graph.subscriptions) == ["/tf", "/tf_static", "own_pose", "points"]
    assert diagnosis(graph)[1] == "idle"
    node.destroy_node()


def test_a_parameter_that_cannot_be_ends_it_with_a_line(graph: Graph):
    from firstfix_ros.node import main

    graph.parameters["map_id"] = ""
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert len(graph.log) == 1
