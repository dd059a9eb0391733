"""Robots on a real ROS 2, Jazzy and Kilted on Fast DDS, and the gateway on rclpy."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix.transform import Matrix, inverse, make_transform, rotation_z
from firstfix_cli.local_service import LocalService, local_service
from firstfix_client import Client
from plugins.fleet.tests.robots.dds_world import Scene, check_pose
from tests.robots.real_robots import T_ODOM_BASE, Gateway, Network, RosRobots, numbers_of, ros_robots
from tests.robots.real_ros import ONE_AND_OTHERS, real_ros
from tests.robots.robot_program import T_BASE_SENSOR, write_points
from tests.waiting import wait_until

MAP, WITHIN_M = "yard", 0.2
OK, WARN, ERROR = 0, 1, 2


@pytest.fixture(scope="module")
def service(small_version: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalService]:
    root = tmp_path_factory.mktemp("yard")
    folder = small_version.directory
    Catalog(Store.open(str(root / "store"))).publish(MAP, folder, Manifest.for_directory(folder))
    with local_service(root / "service", root / "store") as running:
        yield running


@pytest.fixture(scope="module")
def scenes(service: LocalService, small_scans: Any, tmp_path_factory: pytest.TempPathFactory) -> list[Scene]:
    folder = tmp_path_factory.mktemp("scenes")
    with Client(service.url) as client:  # some scans of the world are ambiguous
        answers = [client.localize(scan, map_id=MAP) for scan, _ in small_scans]
    found = [one for one, answer in zip(small_scans, answers, strict=True) if answer.T_map_sensor is not None]
    assert len(found) >= 3
    return [Scene(write_points(scan, folder / f"{n}.bin"), T) for n, (scan, T) in enumerate(found)]


@pytest.fixture(scope="module")
def nowhere(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    spread = np.random.default_rng(1).uniform(-20, 20, (20_000, 3))
    return Scene(write_points(Scan(spread), tmp_path_factory.mktemp("nowhere") / "points.bin"), np.eye(4))


@pytest.fixture(scope="module", params=ONE_AND_OTHERS)
def network(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Network:
    return Network(real_ros(request.param), tmp_path_factory.mktemp(request.param))


@pytest.fixture(scope="module")
def robots(network: Network) -> Iterator[RosRobots]:
    with ros_robots(network.ros, network.environment) as running:
        yield running


@pytest.fixture(scope="module")
def gateway(network: Network, service: LocalService) -> Iterator[Gateway]:
    with network.gateway(service.url, MAP, "--imu", "imu") as running:
        yield running
        assert running.end() == 0, running.text
        assert "defect" not in running.text


def test_robots_of_all_kinds_get_their_pose(robots: RosRobots, gateway: Gateway, scenes: list[Scene]):
    kinds: dict[str, dict[str, Any]] = {
        "/fleet/reliable": {"reliable": True},
        "/fleet/ouster": {"point_step": 48, "rows": 2},
        "/late_clock": {"late_s": 2.0},
        "/packed": {"form": "zlib"},
        "/livox": {"form": "livox", "every_s": 1.0},
        "": {},
    }
    for number, (namespace, options) in enumerate(kinds.items()):
        scene = scenes[number % len(scenes)]
        robots.robot(namespace, **options).show(scene.points, scene.T_map_sensor)
    for number, namespace in enumerate(kinds):
        robot, scene = robots.robots[namespace], scenes[number % len(scenes)]
        assert check_pose(robot.wait_for("initialpose"), scene) < WITHIN_M, namespace
        assert check_pose(robot.wait_for("first_fix/pose"), scene) < WITHIN_M
        robot.wait_for("tf", 3)
        wait_until(lambda of=robot: of.says(message="localized"))
        assert robot.status["hardware_id"] == (namespace or "/")
        robot.call(1)
        assert robot.wait_for("response")["message"]["success"]
        robot.wait_for("initialpose", 2)
        robot.go()


def test_a_robot_that_is_nowhere_is_told_and_then_found(
    robots: RosRobots, gateway: Gateway, scenes: list[Scene], nowhere: Scene
):
    robot = robots.robot("/lost")
    robot.show(nowhere.points, nowhere.T_map_sensor)
    wait_until(lambda: robot.says(state="not localized"))
    assert robot.status["message"].startswith("not localized: ")
    assert robot.status["level"] == WARN
    assert robot.status["values"]["reasons"]
    broken = {"points": str(scenes[0].points), "acceleration": [0, 0, 9.81], "point_step": 5}
    robot.tell(show=broken)
    wait_until(lambda: robot.says(state="failed"))
    assert robot.status["level"] == ERROR
    assert not robot.of("initialpose")
    robot.show(scenes[0].points, scenes[0].T_map_sensor)
    assert check_pose(robot.wait_for("initialpose"), scenes[0]) < WITHIN_M
    robot.go()


def test_frames_may_come_late_and_are_named_while_they_are_missing(
    robots: RosRobots, gateway: Gateway, scenes: list[Scene]
):
    robot = robots.robot("/unmounted", fixed=False, odometry=False)
    robot.show(scenes[0].points, scenes[0].T_map_sensor)
    wait_until(lambda: robot.says(level=ERROR))
    assert "no transform between the frames 'base_link' and 'os_sensor'" in robot.status["message"]
    assert not robot.of("initialpose")
    robot.fix()
    assert check_pose(robot.wait_for("initialpose"), scenes[0]) < WITHIN_M
    wait_until(lambda: robot.says(missing_tf="odom -> base_link"))
    assert not robot.of("tf")
    robot.go()


def test_a_robot_may_go_and_come_again(robots: RosRobots, gateway: Gateway, scenes: list[Scene]):
    for _ in range(2):
        robot = robots.robot("/restless")
        robot.show(scenes[1].points, scenes[1].T_map_sensor)
        assert check_pose(robot.wait_for("initialpose"), scenes[1]) < WITHIN_M
        left = gateway.text.count("/restless  gone")
        robot.go()
        wait_until(lambda before=left: gateway.text.count("/restless  gone") > before)


def test_of_two_robots_with_one_name_neither_gets_the_others_pose(
    robots: RosRobots, network: Network, gateway: Gateway, scenes: list[Scene]
):
    with ros_robots(network.ros, network.environment) as others:
        twins = [one.robot("/twin") for one in (robots, others)]
        for robot in twins:
            wait_until(lambda of=robot: "2 nodes /twin/robot publish" in of.status.get("message", ""))
        for robot, scene in zip(twins, scenes, strict=False):
            robot.show(scene.points, scene.T_map_sensor)
        heard = len(twins[0].of("first_fix/status"))
        wait_until(lambda: len(twins[0].of("first_fix/status")) >= heard + 3)
        assert twins[0].status["level"] == ERROR
        assert not any(robot.of("initialpose") for robot in twins)
        twins[1].go()
        assert check_pose(twins[0].wait_for("initialpose"), scenes[0]) < WITHIN_M
        twins[0].go()


def test_map_to_odom_ends_when_the_robot_publishes_its_own(
    robots: RosRobots, gateway: Gateway, scenes: list[Scene]
):
    robot = robots.robot("/tracker")
    robot.show(scenes[0].points, scenes[0].T_map_sensor)
    robot.wait_for("tf", 3)
    own = make_transform(np.eye(3), [9.0, 9.0, 0.0])
    robot.tell(localize={"map_to_odom": numbers_of(own)})

    def is_own(event: dict[str, Any]) -> bool:
        return bool(event["message"]["transform"]["translation"]["x"] == 9.0)

    wait_until(lambda: sum(map(is_own, robot.of("tf"))) >= 5)
    before = len(robot.of("tf"))
    wait_until(lambda: len(robot.of("tf")) >= before + 10)
    assert all(map(is_own, robot.of("tf")[before:]))
    robot.go()


def test_calls_are_answered_and_carried_out(
    robots: RosRobots, network: Network, service: LocalService, scenes: list[Scene]
):
    with network.gateway(service.url, MAP, "--no-at-start", "--points", "asked/points", "--young", "0"):
        robot = robots.robot("/asker", points="asked/points", point_step=48)
        robot.show(scenes[0].points, scenes[0].T_map_sensor)
        robot.wait_for("service")
        for number in range(1, 6):
            assert len(robot.of("initialpose")) == number - 1, "a pose that nobody asked for"
            robot.call(number)
            assert robot.wait_for("response", number)["message"]["success"]
            assert check_pose(robot.wait_for("initialpose", number), scenes[0]) < WITHIN_M
        robot.go()
        # 12.6 MB in hundreds of datagrams: what is lost of a reliable cloud is sent again.
        big = robots.robot("/big", points="asked/points", point_step=48, every_s=0.5, reliable=True)
        big.tell(show={"points": str(scenes[0].points), "acceleration": [0, 0, 9.81], "count": 262_144})
        big.call(1)
        assert check_pose(big.wait_for("initialpose"), scenes[0]) < WITHIN_M
        big.go()


def test_the_watch_tells_who_has_gone_astray(
    robots: RosRobots, network: Network, service: LocalService, scenes: list[Scene]
):
    options = ("--points", "watched", "--watch", "0.5", "--no-publish-tf", "--own-pose", "own_pose")
    with network.gateway(service.url, MAP, *options):
        by_tf, by_pose = (robots.robot(name, points="watched") for name in ("/by_tf", "/by_pose"))
        for robot in (by_tf, by_pose):
            robot.show(scenes[0].points, scenes[0].T_map_sensor)
            robot.wait_for("initialpose")
        T_map_base = scenes[0].T_map_sensor @ inverse(T_BASE_SENSOR)
        _localize_both(by_tf, by_pose, T_map_base)
        for robot in (by_tf, by_pose):
            wait_until(lambda of=robot: of.says(own_localization="healthy"))
        poses = [len(robot.of("initialpose")) for robot in (by_tf, by_pose)]
        _localize_both(by_tf, by_pose, make_transform(rotation_z(0.1), [3.0, 0.0, 0.0]) @ T_map_base)
        for robot in (by_tf, by_pose):
            wait_until(lambda of=robot: of.says(own_localization="astray"))
            assert robot.status["level"] == ERROR
        assert [len(robot.of("initialpose")) for robot in (by_tf, by_pose)] == poses, "moved unasked"
        for robot in (by_tf, by_pose):
            robot.go()


def _localize_both(by_tf: Any, by_pose: Any, T_map_base: Matrix) -> None:
    by_tf.tell(localize={"map_to_odom": numbers_of(T_map_base @ inverse(T_ODOM_BASE))})
    by_pose.tell(localize={"own_pose": numbers_of(T_map_base)})


def test_one_topic_has_the_frames_of_all(
    robots: RosRobots, network: Network, service: LocalService, scenes: list[Scene]
):
    options = ("--points", "shared", "--tf", "/tf", "--tf-static", "/tf_static")
    with network.gateway(service.url, MAP, *options):
        robot = robots.robot("/of_one_tree", points="shared", tf="/tf")
        robot.show(scenes[0].points, scenes[0].T_map_sensor)
        assert check_pose(robot.wait_for("initialpose"), scenes[0]) < WITHIN_M
        robot.wait_for("tf", 3)
        robot.go()


def test_a_gateway_that_starts_again_finds_the_robot_again(
    robots: RosRobots, network: Network, service: LocalService, scenes: list[Scene]
):
    robot = robots.robot("/patient", points="again")
    robot.show(scenes[0].points, scenes[0].T_map_sensor)
    for number, how in enumerate((signal.SIGKILL, signal.SIGTERM), 1):
        with network.gateway(service.url, MAP, "--points", "again") as gateway:
            event = robot.wait_for("initialpose", number)
            assert check_pose(event, scenes[0]) < WITHIN_M
            assert gateway.end(how) == (0 if how is not signal.SIGKILL else -signal.SIGKILL), gateway.text
    robot.go()
