"""The first fix of a running robot: queries, published poses and status."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

import ros_samples
from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import MalformedData, Overloaded
from firstfix.ros.pose_message import TYPE
from firstfix.scan.scan import Scan
from firstfix.transform import inverse, make_transform, rotation_z
from firstfix_client import ServiceUnreachable
from firstfix_client.first_fix import FirstFix, FirstFixConfig, State
from ros_samples import ROS2, cdr, cloud_of_points
from waiting import LIMIT_S, wait_until

S = 10**9
POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
BASE_LIDAR = make_transform(rotation_z(0.2), [0.1, 0, 0.9])
LIDAR_IMU = make_transform([[1, 0, 0], [0, -1, 0], [0, 0, -1]], [0, 0, -0.1])  # upside down
REJECTED = Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))


def localized(options: LocalizeOptions) -> Localization:
    base = None if options.T_base_sensor is None else POSE @ inverse(options.T_base_sensor)
    return Localization(Verdict.LOCALIZED, (), POSE, base, np.eye(6), 0.99)


def cloud(points: int = 5, stamp_ns: int = 7 * S) -> bytes:
    return cdr(cloud_of_points(np.ones((points, 3)), stamp_ns=stamp_ns, frame_id="lidar"))


class Asked:
    """Gives the set answers in order, and repeats the last one."""

    def __init__(self, *answers: Any) -> None:
        self.answers = list(answers)
        self.queries: list[tuple[Scan, LocalizeOptions]] = []
        self.gate = threading.Event()
        self.gate.set()
        self.poses: list[Any] = []

    def __call__(self, scan: Scan, options: LocalizeOptions) -> Localization:
        self.queries.append((scan, options))
        assert self.gate.wait(LIMIT_S)
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return localized(options) if answer is localized else answer

    def publish(self, body: bytes, answer: Localization) -> None:
        self.poses.append(ROS2.deserialize_cdr(body, TYPE))


def first_fix(asked: Asked, **config: Any) -> FirstFix:
    frames = {("base_link", "lidar"): BASE_LIDAR, ("lidar", "imu"): LIDAR_IMU}
    wished = FirstFixConfig(retry_s=0.0, **config)
    return FirstFix(asked, asked.publish, wished, lambda target, source: frames.get((target, source)))


def test_one_cloud_is_enough():
    asked = Asked(localized)
    with first_fix(asked, map_frame="hall") as fix:
        assert fix.status.state is State.IDLE
        fix.on_cloud(cloud())  # nobody wants it
        fix.want()
        assert fix.status.state is State.WAITING
        fix.on_cloud(cloud(9))
        wait_until(lambda: fix.status.state is State.LOCALIZED)
        assert not fix.wanted
        fix.on_cloud(cloud())
    assert [len(scan) for scan, _ in asked.queries] == [9]
    (pose,) = asked.poses
    assert (pose.header.frame_id, pose.header.stamp.sec, pose.pose.pose.position.x) == ("hall", 7, 12)
    assert fix.status.tries == 1


def test_it_goes_on_until_a_cloud_is_localized():
    asked = Asked(REJECTED, ServiceUnreachable("nobody"), Overloaded("full"), RuntimeError("oh"), localized)
    seen = []
    with first_fix(asked) as fix:
        fix.want()
        for number in range(5):
            tried = number + 1
            fix.on_cloud(cloud())
            wait_until(lambda tried=tried: fix.status.tries == tried and fix.status.state is not State.ASKING)
            seen.append((fix.status.state, fix.status.error))
    assert seen == [
        (State.NOT_LOCALIZED, ""),
        (State.FAILED, "nobody"),
        (State.FAILED, "full"),
        (State.FAILED, "defect: RuntimeError('oh')"),
        (State.LOCALIZED, ""),
    ]
    assert len(asked.poses) == 1


def test_a_damaged_cloud_fails_and_the_next_one_counts():
    asked = Asked(localized)
    with first_fix(asked) as fix:
        fix.want()
        fix.on_cloud(cloud()[:-5])
        wait_until(lambda: fix.status.state is State.FAILED)
        assert fix.status.error.startswith("PointCloud2: ")
        fix.on_cloud(cloud())
        wait_until(lambda: fix.status.state is State.LOCALIZED)


def test_only_the_newest_cloud_is_asked_for():
    asked = Asked(REJECTED, localized)
    asked.gate.clear()
    with first_fix(asked) as fix:
        fix.want()
        fix.on_cloud(cloud(1))
        wait_until(lambda: asked.queries)
        for points in (2, 3, 4):
            fix.on_cloud(cloud(points))
        asked.gate.set()
        wait_until(lambda: fix.status.state is State.LOCALIZED)
    assert [len(scan) for scan, _ in asked.queries] == [1, 4]


def test_a_cloud_that_came_while_it_asked_is_forgotten_with_the_fix():
    asked = Asked(localized)
    asked.gate.clear()
    with first_fix(asked) as fix:
        fix.want()
        fix.on_cloud(cloud(1))
        wait_until(lambda: asked.queries)
        fix.on_cloud(cloud(2))
        asked.gate.set()
        wait_until(lambda: fix.status.state is State.LOCALIZED)
        fix.want()
        fix.on_cloud(cloud(3))
        wait_until(lambda: len(asked.poses) == 2)
    assert [len(scan) for scan, _ in asked.queries] == [1, 3]


def test_who_asks_anew_while_it_asks_gets_a_newer_fix():
    asked = Asked(localized)
    asked.gate.clear()
    with first_fix(asked) as fix:
        fix.want()
        fix.on_cloud(cloud(1))
        wait_until(lambda: asked.queries)
        fix.want()
        asked.gate.set()
        wait_until(lambda: asked.poses)
        assert fix.wanted, "the answer belongs to the wish before"
        fix.on_cloud(cloud(2))
        wait_until(lambda: fix.status.state is State.LOCALIZED)
    assert len(asked.poses) == 2


def test_gravity_and_the_mounting_are_looked_up():
    asked = Asked(localized)
    with first_fix(asked, base_frame="base_link", options=LocalizeOptions(max_candidates=3)) as fix:
        fix.on_imu(cdr(ros_samples.imu([0, 0, -9.81], stamp_ns=7 * S, frame_id="imu")))
        fix.want()
        fix.on_cloud(cloud())
        wait_until(lambda: fix.status.state is State.LOCALIZED)
    (_, options) = asked.queries[0]
    np.testing.assert_allclose(options.gravity, [0, 0, -1], atol=1e-12)
    np.testing.assert_array_equal(options.T_base_sensor, BASE_LIDAR)
    assert options.max_candidates == 3
    position = asked.poses[0].pose.pose.position
    np.testing.assert_allclose([position.x, position.y], (POSE @ inverse(BASE_LIDAR))[:2, 3])


def test_a_gravity_that_cannot_be_turned_is_left_out():
    asked = Asked(localized)
    with first_fix(asked) as fix:
        fix.on_imu(cdr(ros_samples.imu([0, 0, 9.81], stamp_ns=7 * S, frame_id="elsewhere")))
        fix.want()
        fix.on_cloud(cloud())
        wait_until(lambda: fix.status.state is State.LOCALIZED)
    assert asked.queries[0][1].gravity is None


def test_the_robots_pose_is_never_the_sensors():
    asked = Asked(localized)
    with first_fix(asked, base_frame="base_footprint") as fix:
        fix.want()
        fix.on_cloud(cloud())
        wait_until(lambda: fix.status.state is State.FAILED)
        assert fix.status.error == "no transform between the frames 'base_footprint' and 'lidar' yet"
    assert not asked.poses


def test_a_pose_that_cannot_be_published_is_told():
    asked = Asked(localized)
    asked.publish = lambda *_: 1 / 0
    with first_fix(asked) as fix:
        fix.want()
        fix.on_cloud(cloud())
        wait_until(lambda: fix.status.state is State.FAILED)
        assert "ZeroDivisionError" in fix.status.error


def test_what_is_no_imu_is_said():
    with first_fix(Asked(localized)) as fix, pytest.raises(MalformedData):
        fix.on_imu(b"x")
