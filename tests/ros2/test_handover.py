"""The handover of a fix to the robot's localizer, in simulated time: localizers that start late."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.transform import Matrix, from_quaternion, inverse, make_transform, rotation_z
from firstfix_ros.robot.handover import Stage
from firstfix_ros.robot.topics import Input, Output
from tests.every_case import every_case
from tests.ros2.test_robot_gateway import BASE_LIDAR, POSE, Bench, S, localized, tf

T_MAP_BASE = POSE @ inverse(BASE_LIDAR)
T_MAP_ODOM = make_transform(rotation_z(1.0), [5.0, -3.0, 0.4])
HERE, AWAY = np.eye(4), make_transform(np.eye(3), [3.0, 0, 0])


class Robot:
    """A robot that got its fix at time 0, drives along its x axis, and may run a localizer."""

    def __init__(self, *, odometry: bool = True, speed_m_s: float = 0.5, **config: Any) -> None:
        self.time_s, self.odometry, self.speed_m_s = 0.0, odometry, speed_m_s
        self.T_true = T_MAP_BASE
        self.error: Matrix | None = None  # of its localizer; None: the localizer is not heard
        self.set_back = HERE  # of the odometry
        self.start(**config)

    def start(self, **config: Any) -> None:
        """Starts a gateway, and lets it ask once."""
        self.bench = Bench(self.answer, mounted=True, **config)
        self.bench.localizers = 0 if self.error is None else 1
        self.send()
        self.bench.cloud(stamp_ns=self.stamp_ns)

    @property
    def stamp_ns(self) -> int:
        return 7 * S + round(self.time_s * S)

    def answer(self, options: LocalizeOptions) -> Localization:
        return localized(options, self.T_true @ BASE_LIDAR)

    def send(self) -> None:
        take = self.bench.gateway.take
        if self.odometry:
            T_odom_base = self.set_back @ inverse(T_MAP_ODOM) @ self.T_true
            take(Input.TF, tf("odom", "base_link", T_odom_base, self.stamp_ns))
            if self.error is not None:
                T_map_odom = self.error @ T_MAP_ODOM @ inverse(self.set_back)
                take(Input.TF, tf("map", "odom", T_map_odom, self.stamp_ns))
        elif self.error is not None:
            take(Input.TF, tf("map", "base_link", self.error @ self.T_true, self.stamp_ns))

    def drive(self, seconds: float, step_s: float = 0.1) -> None:
        for _ in range(round(seconds / step_s)):
            self.time_s += step_s
            self.bench.now_s += step_s
            self.T_true = self.T_true @ make_transform(np.eye(3), [self.speed_m_s * step_s, 0, 0])
            self.send()
            self.bench.gateway.tick()

    @property
    def poses(self) -> list[Any]:
        return self.bench.of(Output.INITIAL_POSE)

    @property
    def stage(self) -> Stage | None:
        return self.bench.gateway.status.stage


def matrix(pose: Any) -> Matrix:
    p, q = pose.pose.pose.position, pose.pose.pose.orientation
    return from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def test_a_localizer_that_starts_late_gets_the_pose_where_the_robot_is_now():
    robot = Robot()
    robot.drive(30)
    assert (len(robot.poses), robot.stage) == (1, Stage.WAITING)
    robot.bench.localizers = 1
    robot.drive(0.1)
    first, late = robot.poses
    np.testing.assert_allclose(matrix(late), robot.T_true, atol=1e-9)
    assert late.header.stamp.sec * S + late.header.stamp.nanosec == robot.stamp_ns
    drift_m2 = late.pose.covariance[0] - first.pose.covariance[0]
    assert drift_m2 > (0.02 * 15) ** 2 * 0.99, "15 m of odometry are in the covariance"
    robot.error = HERE
    robot.drive(20)
    assert (len(robot.poses), robot.stage) == (2, Stage.FOLLOWED)


def test_twenty_localizers_that_start_at_any_time_get_the_pose_where_the_robot_is():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        robot = Robot(speed_m_s=rng.uniform(0, 0.8))
        robot.drive(rng.uniform(0, 60), step_s=0.5)
        robot.bench.localizers = 1
        robot.drive(5)
        error_m = np.linalg.norm(matrix(robot.poses[-1])[:3, 3] - robot.T_true[:3, 3])
        assert len(robot.poses) >= 2
        assert error_m <= 5 * robot.speed_m_s + 1e-6


def test_a_localizer_that_does_not_follow_gets_the_pose_again_but_not_too_often():
    robot = Robot(repeat_s=2.0)
    robot.bench.localizers, robot.error = 1, AWAY
    robot.drive(20.05)
    assert 9 <= len(robot.poses) - 1 <= 10
    robot.error = HERE
    robot.drive(20)
    assert robot.stage is Stage.FOLLOWED
    assert len(robot.poses) <= 11


def test_subscribers_that_come_and_go_do_not_get_it_more_often():
    robot = Robot(repeat_s=2.0, speed_m_s=0.0)
    for number in range(100):
        robot.bench.localizers = number % 2
        robot.drive(0.2, step_s=0.2)
    assert len(robot.poses) <= 1 + 10


def test_a_localizer_that_is_not_heard_is_not_set_back_once_the_robot_drives():
    robot = Robot(speed_m_s=0.0, repeat_s=2.0, young_s=6.0)
    robot.bench.localizers = 1
    robot.drive(3)
    before = len(robot.poses)
    assert before > 1
    robot.speed_m_s = 1.0
    robot.drive(30)
    assert (len(robot.poses), robot.stage) == (before, Stage.PUBLISHED)


def test_it_can_be_published_once():
    robot = Robot(repeat_s=0.0)
    robot.bench.localizers, robot.error = 1, AWAY
    robot.drive(20)
    assert len(robot.poses) == 1
    assert robot.bench.gateway.needs == frozenset()


def test_without_odometry_it_is_repeated_while_it_is_young():
    robot = Robot(odometry=False, speed_m_s=0.0, repeat_s=2.0, young_s=6.0)
    robot.drive(4)
    robot.bench.localizers = 1
    robot.drive(1)
    assert len(robot.poses) == 2
    np.testing.assert_allclose(matrix(robot.poses[1]), T_MAP_BASE, atol=1e-9)
    robot.drive(20)
    assert (len(robot.poses), robot.stage) == (2, Stage.OLD)


def too_old(robot: Robot) -> None:
    robot.drive(12)


def odometry_set_back(robot: Robot) -> None:
    robot.drive(2)
    robot.set_back = AWAY
    robot.drive(2)


def odometry_with_a_gap(robot: Robot) -> None:
    robot.drive(2)
    robot.odometry = False
    robot.drive(4)
    robot.odometry = True
    robot.drive(1)


def odometry_that_has_ended(robot: Robot) -> None:
    robot.drive(2)
    robot.odometry = False
    robot.drive(4)


def a_long_way(robot: Robot) -> None:
    robot.speed_m_s = 5.0
    robot.drive(12)


@every_case(
    "odometry, happens",
    [
        (False, too_old),
        (True, odometry_set_back),
        (True, odometry_with_a_gap),
        (True, odometry_that_has_ended),
        (True, a_long_way),
    ],
)
def test_a_localizer_for_which_no_pose_is_left_gets_a_new_search(odometry: bool, happens: Any):
    robot = Robot(odometry=odometry, young_s=10.0)
    happens(robot)
    assert (len(robot.poses), robot.stage) == (1, Stage.OLD)
    robot.drive(1)
    assert not robot.bench.gateway.wanted, "nobody is there"
    robot.bench.localizers = 1
    robot.drive(0.1)
    assert len(robot.poses) == 1
    assert robot.bench.gateway.wanted
    robot.speed_m_s = 0.0
    robot.bench.cloud(stamp_ns=robot.stamp_ns)
    robot.drive(1.5)
    np.testing.assert_allclose(matrix(robot.poses[-1]), robot.T_true, atol=1e-9)


@pytest.mark.parametrize("at_start", [True, False])
def test_a_localizer_that_is_started_again_gets_a_new_search(at_start: bool):
    robot = Robot()
    robot.bench.localizers, robot.error = 1, HERE
    robot.drive(10)
    assert robot.stage is Stage.FOLLOWED
    assert robot.bench.gateway.needs == frozenset(), "a robot that knows where it is costs nothing"
    robot.bench.localizers = 2
    robot.drive(10)
    assert not robot.bench.gateway.wanted, "somebody only listens: the localizer is still heard"
    robot.bench.localizers, robot.error = 0, None
    robot.drive(100)
    robot.bench.localizers = 1
    robot.drive(6)
    assert robot.bench.gateway.wanted
