"""The watch over a robot that drives, in simulated time: a robot that was moved, and robots that were not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.transform import Matrix, inverse, make_transform, rotation_z
from firstfix_ros.robot.status import State
from firstfix_ros.robot.topics import Input, Output
from firstfix_ros.robot.watch import Health
from tests.ros2.test_robot_gateway import BASE_LIDAR, REJECTED, Bench, S, hypothesis, localized, tf

RADIUS_M, SPEED_M_S = 8.0, 1.5


class Drive:
    """A robot on a circle, with odometry that drifts, and a localization of its own."""

    def __init__(self, seed: int = 0, *, own: str = "tf", planar: bool = False, **config: Any) -> None:
        self.rng = np.random.default_rng(seed)
        self.bench = Bench(self.answer, mounted=True, at_start=False, **{"watch_s": 1.0, **config})
        self.own, self.planar = own, planar
        self.time_s = 0.0
        self.T_moved = np.eye(4)  # by hand: odometry does not feel it
        self.T_map_odom = make_transform(rotation_z(1.0), [5.0, -3.0, 0.0])
        self.replaces: Any = None
        self.noise_m = 0.03

    def T_map_base(self) -> Matrix:
        return self.T_moved @ self.by_odometry()

    def by_odometry(self) -> Matrix:
        """Pose by the robot's own localization."""
        angle = self.time_s * SPEED_M_S / RADIUS_M
        return make_transform(
            rotation_z(angle + np.pi / 2), [RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle), 0]
        )

    def answer(self, options: LocalizeOptions) -> Localization:
        if self.replaces is not None:
            return self.replaces(options)
        T = self.T_map_base() @ BASE_LIDAR
        T = T.copy()
        T[:3, 3] += self.rng.normal(0, self.noise_m, 3)
        if options.prior is not None and not options.prior.allows(T):
            return REJECTED
        return localized(options, T)

    def step(self, seconds: float = 0.1) -> None:
        self.time_s += seconds
        self.bench.now_s += seconds
        stamp_ns = round(self.time_s * 1e9) + 7 * S
        take = self.bench.gateway.take
        take(Input.TF, tf("odom", "base_link", inverse(self.T_map_odom) @ self.by_odometry(), stamp_ns))
        if self.own == "tf":
            take(Input.TF, tf("map", "odom", self.T_map_odom, stamp_ns + S // 2))
        self.bench.cloud(stamp_ns=stamp_ns)

    @property
    def health(self) -> Health | None:
        return self.bench.gateway.status.health


def moved(x: float, y: float = 0.0, yaw: float = 0.0) -> Matrix:
    return make_transform(rotation_z(yaw), [x, y, 0])


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_that_is_moved_by_2_m_is_noticed_within_3_s(seed: int):
    drive = Drive(seed)
    for _ in range(30 + seed):
        drive.step()
    assert drive.health is Health.HEALTHY
    drive.T_moved = moved(*(2 * np.array([np.cos(seed), np.sin(seed)])))
    begin_s = drive.time_s
    while drive.health is not Health.ASTRAY:
        drive.step()
        assert drive.time_s - begin_s <= 3.0
    offset = drive.bench.gateway.status.offset
    assert offset is not None
    assert offset.distance_m == pytest.approx(2.0, abs=0.2)
    assert not drive.bench.of(Output.INITIAL_POSE), "it never moves the robot unasked"
    assert not drive.bench.of(Output.TF)
    assert "astray by" in drive.bench.told[-1]
    drive.T_moved = np.eye(4)
    for _ in range(12):
        drive.step()
    assert drive.health is Health.HEALTHY


def test_one_that_is_carried_far_away_is_found_without_the_prior():
    drive = Drive()
    for _ in range(12):
        drive.step()
    drive.T_moved = moved(60.0, 20.0, 2.0)
    for _ in range(30):
        drive.step()
    assert drive.health is Health.ASTRAY
    priors = [options.prior for _, options in drive.bench.queries]
    assert None in priors
    assert priors[0] is not None


def test_there_is_no_false_alarm_in_a_thousand_checks():
    drive = Drive(7)
    drive.noise_m = 0.15
    wrong = 0

    def sometimes_wrong(options: LocalizeOptions) -> Localization:
        nonlocal wrong
        drive.replaces = None
        answer = drive.answer(options)
        drive.replaces = sometimes_wrong
        if drive.rng.random() < 0.02:  # of all fixes: a wrong place, with confidence
            wrong += 1
            return localized(options, moved(*drive.rng.uniform(-30, 30, 2)) @ BASE_LIDAR)
        return REJECTED if drive.rng.random() < 0.2 else answer

    drive.replaces = sometimes_wrong
    seen = set()
    while len(drive.bench.queries) < 1000:
        drive.step(0.5)
        seen.add(drive.health)
    assert wrong > 10
    assert Health.SUSPECT in seen
    assert Health.ASTRAY not in seen
    assert not drive.bench.of(Output.INITIAL_POSE)


def test_two_wrong_fixes_that_do_not_agree_are_no_alarm():
    drive = Drive()
    drive.replaces = lambda options: localized(options, moved(*drive.rng.uniform(-30, 30, 2)) @ BASE_LIDAR)
    for _ in range(100):
        drive.step()
    assert drive.health is Health.SUSPECT


def test_a_pose_that_explains_the_scan_as_well_is_no_alarm():
    drive = Drive()
    other = moved(5.0) @ BASE_LIDAR

    def two(options: LocalizeOptions) -> Localization:
        own = hypothesis(drive.T_map_base() @ BASE_LIDAR, score=0.88)
        return replace(localized(options, other), hypotheses=(hypothesis(other), own))

    drive.T_moved = np.eye(4)
    drive.replaces = two
    for _ in range(50):
        drive.step()
    assert drive.health is Health.UNKNOWN


def test_an_uncertain_fix_is_no_alarm():
    drive = Drive()
    corridor = np.diag([4.0, 0.01, 0.01, 1e-4, 1e-4, 1e-4])

    def uncertain(options: LocalizeOptions) -> Localization:
        T = moved(3.0) @ drive.T_map_base() @ BASE_LIDAR
        return replace(localized(options, T), covariance=corridor)

    drive.replaces = uncertain
    for _ in range(50):
        drive.step()
    assert drive.health is Health.HEALTHY


def test_a_localization_in_the_plane_knows_no_height():
    drive = Drive()
    drive.T_moved = make_transform(np.eye(3), [0, 0, 7.0])  # on a hill
    for _ in range(30):
        drive.step()
    assert drive.health is Health.HEALTHY
    drive.T_map_odom = make_transform(rotation_z(1.0), [5.0, -3.0, 0.01])  # this one knows it
    for _ in range(60):
        drive.step()
    assert drive.health is Health.ASTRAY


def test_without_its_own_localization_there_is_nothing_to_compare():
    drive = Drive(own="none")
    for _ in range(30):
        drive.step()
    assert drive.health is Health.UNKNOWN
    assert len(drive.bench.of(Output.POSE)) > 1
    assert drive.bench.queries[-1][1].prior is not None, "the last fix, carried on by odometry"
    drive.step(1.0)
    where = drive.T_map_base() @ BASE_LIDAR
    np.testing.assert_allclose(drive.bench.queries[-1][1].prior.position_m, where[:3, 3], atol=0.3)


def test_the_odometry_goes_with_each_query_and_once_a_minute_no_prior():
    drive = Drive()
    drive.step()
    asked = []
    for _ in range(150):
        drive.step(1.0)
        asked.append((drive.time_s, drive.bench.queries[-1][1]))
    T_odom_base = inverse(drive.T_map_odom) @ drive.by_odometry()
    np.testing.assert_allclose(asked[-1][1].T_odom_base, T_odom_base, atol=1e-9)
    anywhere_s = [time_s for time_s, options in asked if options.prior is None]
    assert anywhere_s == pytest.approx([60.1, 120.1]), "such fixes can confirm each other"
    assert drive.health is Health.HEALTHY


def test_a_check_that_finds_nothing_anywhere_asks_about_its_pose():
    drive = Drive()

    def only_with_a_prior(options: LocalizeOptions) -> Localization:
        if options.prior is None:
            return REJECTED
        return localized(options, drive.T_map_base() @ BASE_LIDAR)

    drive.replaces = only_with_a_prior
    for _ in range(70):
        drive.step(1.0)
    priors = [options.prior is None for _, options in drive.bench.queries]
    assert priors.count(True) == 1
    assert drive.health is Health.HEALTHY


def test_without_odometry_a_query_has_none():
    bench = Bench(localized)
    bench.cloud()
    assert bench.queries[0][1].T_odom_base is None


def test_poses_of_a_topic_are_carried_on_by_odometry():
    from firstfix.ros.header import Stamp
    from firstfix.ros.pose_message import to_pose_cdr

    drive = Drive(own="topic")
    drive.step()
    own = localized(LocalizeOptions(), drive.by_odometry())
    drive.bench.gateway.take(Input.OWN_POSE, to_pose_cdr(own, Stamp.of_ns(round(drive.time_s * 1e9) + 7 * S)))
    for _ in range(30):
        drive.step()
    assert drive.health is Health.HEALTHY
    drive.T_moved = moved(0, 2.0)
    for _ in range(30):
        drive.step()
    assert drive.health is Health.ASTRAY


def test_a_wanted_fix_begins_anew():
    drive = Drive()
    drive.T_moved = moved(2.0)
    for _ in range(30):
        drive.step()
    assert drive.health is Health.ASTRAY
    drive.bench.gateway.relocalize()
    drive.step()
    assert drive.bench.gateway.status.state is State.LOCALIZED
    assert len(drive.bench.of(Output.INITIAL_POSE)) == 1
    assert drive.health is Health.UNKNOWN
