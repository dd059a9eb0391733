"""The gateway's core with a clock of the test: what it asks, publishes and tells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.quality import AlignmentQuality
from firstfix.errors import InvalidOption, Overloaded
from firstfix.ros.pose_message import covariance_of_base
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, inverse, make_transform, quaternion_of, rotation_z
from firstfix_client.errors import ServiceUnreachable
from firstfix_ros.robot import gateway as module
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.gateway import RobotGateway
from firstfix_ros.robot.status import State
from firstfix_ros.robot.topics import Input, Output
from tests import ros_samples
from tests.ros_samples import ROS2, cdr, cloud_of_points

S = 10**9
POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
BASE_LIDAR = make_transform(rotation_z(0.2), [0.1, 0, 0.9])
LIDAR_IMU = make_transform([[1, 0, 0], [0, -1, 0], [0, 0, -1]], [0, 0, -0.1])  # upside down
ODOM_BASE = make_transform(rotation_z(-0.4), [3.0, 2.0, 0.0])
COVARIANCE = np.diag([0.01, 0.02, 0.03, 0.001, 0.002, 0.003])
REJECTED = Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))


def hypothesis(T: Matrix, score: float = 0.9) -> Hypothesis:
    return Hypothesis(T, AlignmentQuality(0.9, score, 0.0, 0.0), 0.5, 1)


AMBIGUOUS = Localization(
    Verdict.AMBIGUOUS,
    (Reason.SEVERAL_PLACES,),
    hypotheses=(hypothesis(POSE), hypothesis(make_transform(np.eye(3), [1, 2, 3]))),
)


def localized(options: LocalizeOptions, T: Matrix = POSE) -> Localization:
    base = None if options.T_base_sensor is None else T @ inverse(options.T_base_sensor)
    return Localization(Verdict.LOCALIZED, (), T, base, COVARIANCE, 0.99, (hypothesis(T),))


def cloud(points: int = 5, stamp_ns: int = 7 * S) -> bytes:
    return cdr(cloud_of_points(np.ones((points, 3)), stamp_ns=stamp_ns, frame_id="lidar"))


def tf(parent: str, child: str, T: Matrix, stamp_ns: int = 7 * S) -> bytes:
    message = ros_samples.transforms([(parent, child, T)])
    stamp = message.transforms[0].header.stamp
    stamp.sec, stamp.nanosec = divmod(stamp_ns, S)
    return cdr(message)


class Bench:
    """A gateway with a clock, and a table of answers: the last one is repeated."""

    def __init__(self, *answers: Any, mounted: bool = False, **config: Any) -> None:
        self.now_s = 100.0
        self.answers = list(answers)
        self.queries: list[tuple[Scan, LocalizeOptions]] = []
        self.published: list[tuple[Output, bytes]] = []
        self.told: list[str] = []
        self.while_asking: Callable[[], Any] = lambda: None
        self.localizers: int | None = None  # subscribers of the pose
        self.gateway = RobotGateway(
            self.ask,
            lambda kind, body: self.published.append((kind, body)),
            GatewayConfig(**({"base_frame": "base_link"} if mounted else {}), **config),
            subscribers=lambda output: self.localizers,
            log_line=self.told.append,
            clock=lambda: self.now_s,
            wall_ns=lambda: 9 * S,
        )
        if mounted:
            frames = [("base_link", "lidar", BASE_LIDAR), ("lidar", "imu", LIDAR_IMU)]
            self.gateway.take(Input.TF_STATIC, cdr(ros_samples.transforms(frames)))

    def ask(self, scan: Scan, options: LocalizeOptions) -> Localization:
        self.queries.append((scan, options))
        self.while_asking()
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer(options) if callable(answer) else answer

    def cloud(self, points: int = 5, stamp_ns: int = 7 * S) -> bool:
        self.gateway.take(Input.CLOUD, cloud(points, stamp_ns))
        return self.gateway.step()

    def of(self, kind: Output) -> list[Any]:
        return [ROS2.deserialize_cdr(body, kind.ros_type) for one, body in self.published if one is kind]


def test_one_cloud_is_enough_and_then_it_rests():
    bench = Bench(localized, map_frame="hall")
    assert bench.gateway.status.state is State.WAITING
    assert bench.cloud(9)
    assert bench.gateway.status.state is State.LOCALIZED
    assert not bench.cloud(8)
    assert Input.CLOUD not in bench.gateway.needs
    (pose,) = bench.of(Output.INITIAL_POSE)
    assert (pose.header.frame_id, pose.header.stamp.sec) == ("hall", 7)
    np.testing.assert_array_equal(pose.pose.covariance.reshape(6, 6), COVARIANCE)
    bodies = dict(bench.published)
    assert bodies[Output.POSE] == bodies[Output.INITIAL_POSE]
    assert [len(scan) for scan, _ in bench.queries] == [9]
    assert bench.told == ["localized"]


def test_the_pose_is_the_bases_with_its_covariance():
    bench = Bench(localized, mounted=True)
    assert bench.cloud()
    (pose,) = bench.of(Output.INITIAL_POSE)
    T = POSE @ inverse(BASE_LIDAR)
    position, q = pose.pose.pose.position, pose.pose.pose.orientation
    np.testing.assert_allclose([position.x, position.y, position.z], T[:3, 3], atol=1e-12)
    np.testing.assert_allclose([q.x, q.y, q.z, q.w], quaternion_of(T), atol=1e-12)
    expected = covariance_of_base(POSE, T, COVARIANCE)
    np.testing.assert_allclose(pose.pose.covariance.reshape(6, 6), expected, atol=1e-15)
    np.testing.assert_allclose(bench.queries[0][1].T_base_sensor, BASE_LIDAR, atol=1e-12)


def test_gravity_comes_from_the_imu_by_its_mounting():
    bench = Bench(localized, mounted=True)
    bench.gateway.take(Input.IMU, cdr(ros_samples.imu([0, 0, -9.81], stamp_ns=7 * S)))
    assert bench.cloud()
    np.testing.assert_allclose(bench.queries[0][1].gravity, [0, 0, -1], atol=1e-12)


def test_without_the_mounting_nothing_is_asked():
    bench = Bench(localized, base_frame="base_link")
    assert bench.cloud()
    assert not bench.queries
    assert "no transform between the frames 'base_link' and 'lidar'" in bench.gateway.status.error


def test_it_goes_on_until_a_cloud_is_localized_and_waits_between_the_tries():
    bench = Bench(REJECTED, ServiceUnreachable("nobody"), Overloaded("full"), RuntimeError("oh"), localized)
    seen = []
    for _ in range(5):
        assert bench.cloud()
        assert not bench.cloud(), "only after retry_s"
        bench.now_s += 1.0
        seen.append((bench.gateway.status.state, bench.gateway.status.error))
    assert seen == [
        (State.NOT_LOCALIZED, ""),
        (State.FAILED, "nobody"),
        (State.FAILED, "full"),
        (State.FAILED, "defect: RuntimeError('oh')"),
        (State.LOCALIZED, ""),
    ]
    assert bench.gateway.status.tries == 5
    assert len(bench.of(Output.INITIAL_POSE)) == 1


def test_a_damaged_cloud_fails_and_the_next_one_counts():
    bench = Bench(localized)
    bench.gateway.take(Input.CLOUD, cloud()[:-5])
    assert bench.gateway.step()
    assert bench.gateway.status.error.startswith("PointCloud2: ")
    bench.now_s += 1
    assert bench.cloud()
    assert bench.gateway.status.state is State.LOCALIZED


def test_only_the_newest_cloud_is_asked_for():
    bench = Bench(REJECTED, localized, retry_s=0.0)
    bench.while_asking = lambda: [bench.gateway.take(Input.CLOUD, cloud(n)) for n in (2, 3, 4)]
    assert bench.cloud(1)
    assert bench.gateway.step()
    assert [len(scan) for scan, _ in bench.queries] == [1, 4]
    assert not bench.gateway.step(), "what came with the fix is forgotten"


def test_a_pose_that_nobody_waits_for_any_more_is_not_published():
    bench = Bench(localized)
    bench.while_asking = bench.gateway.relocalize
    assert bench.cloud(1)
    assert not bench.of(Output.INITIAL_POSE)
    assert bench.gateway.wanted
    bench.while_asking = lambda: None
    assert bench.cloud(2)
    assert len(bench.of(Output.INITIAL_POSE)) == 1


def test_hypotheses_are_shown_and_taken_away():
    bench = Bench(AMBIGUOUS, localized, mounted=True)
    assert bench.cloud()
    (shown,) = bench.of(Output.HYPOTHESES)
    assert (shown.header.frame_id, shown.header.stamp.sec, len(shown.poses)) == ("map", 7, 2)
    expected = make_transform(np.eye(3), [1, 2, 3]) @ inverse(BASE_LIDAR)
    p = shown.poses[1].position
    np.testing.assert_allclose([p.x, p.y, p.z], expected[:3, 3], atol=1e-12)
    assert not bench.of(Output.POSE)
    bench.now_s += 1
    assert bench.cloud()
    assert [len(one.poses) for one in bench.of(Output.HYPOTHESES)] == [2, 0]


def test_map_to_odom_makes_the_fix_the_pose_of_the_base():
    bench = Bench(localized, mounted=True)
    bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE))
    bench.gateway.tick()
    assert not bench.of(Output.TF)
    assert bench.cloud()
    bench.gateway.take(Input.TF, tf("odom", "base_link", np.eye(4), 8 * S))
    bench.gateway.tick()
    (message,) = bench.of(Output.TF)
    (sent,) = message.transforms
    assert (sent.header.frame_id, sent.child_frame_id) == ("map", "odom")
    assert (sent.header.stamp.sec, sent.header.stamp.nanosec) == (8, 200_000_000)
    t = sent.transform.translation
    expected = POSE @ inverse(BASE_LIDAR) @ inverse(ODOM_BASE)
    np.testing.assert_allclose([t.x, t.y, t.z], expected[:3, 3], atol=1e-12)


@pytest.mark.parametrize("by_another", [False, True])
def test_map_to_odom_ends_when_another_publishes_it(by_another: bool):
    bench = Bench(localized, mounted=True)
    bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE))
    assert bench.cloud()
    bench.gateway.tick()
    own = [body for kind, body in bench.published if kind is Output.TF]
    bench.gateway.take(Input.TF, tf("map", "odom", np.eye(4)) if by_another else own[0])
    bench.gateway.tick()
    assert len(bench.of(Output.TF)) == (1 if by_another else 2)


@pytest.mark.parametrize("late_ms", [0, 400])
def test_odometry_that_is_heard_after_the_answer_completes_the_fix(late_ms: int):
    bench = Bench(localized, mounted=True, repeat_s=0.0)
    assert bench.cloud()
    bench.gateway.tick()
    assert not bench.of(Output.TF)
    assert Input.TF in bench.gateway.needs
    bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE, 7 * S + late_ms * 10**6))
    bench.gateway.tick()
    ((sent,),) = [message.transforms for message in bench.of(Output.TF)]
    t = sent.transform.translation
    expected = POSE @ inverse(BASE_LIDAR) @ inverse(ODOM_BASE)
    np.testing.assert_allclose([t.x, t.y, t.z], expected[:3, 3], atol=1e-12)
    assert not bench.gateway.wanted
    bench.now_s += 2
    bench.gateway.tick()
    assert {"missing_tf"}.isdisjoint(v.key for v in bench.of(Output.STATUS)[-1].status[0].values)


def test_a_gap_in_the_odometry_is_closed_by_its_next_sample():
    bench = Bench(localized, mounted=True)
    bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE, 6 * S))
    assert bench.cloud()
    bench.gateway.tick()
    assert not bench.of(Output.TF)
    bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE, 8 * S))
    bench.gateway.tick()
    assert len(bench.of(Output.TF)) == 1


def test_odometry_that_begins_long_after_the_fix_calls_for_one_new_search():
    bench = Bench(localized, mounted=True)
    assert bench.cloud()
    bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE, 20 * S))
    bench.gateway.tick()
    assert bench.gateway.wanted
    assert "odometry has begun after the last fix" in "".join(bench.told)
    bench.now_s += 2
    assert bench.cloud(stamp_ns=20 * S)
    bench.gateway.tick()
    assert not bench.gateway.wanted
    assert len(bench.of(Output.TF)) == 1


def test_odometry_of_another_clock_does_not_make_it_search_for_ever():
    bench = Bench(localized, mounted=True)
    for seconds in range(10):
        bench.cloud(stamp_ns=(7 + seconds) * S)
        bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE, (1000 + seconds) * S))
        bench.gateway.tick()
        bench.now_s += 1
    assert len(bench.queries) == 2
    assert not bench.gateway.wanted
    assert not bench.of(Output.TF)


def test_map_to_odom_can_be_left_to_others():
    bench = Bench(localized, mounted=True, publishes_tf=False)
    bench.gateway.take(Input.TF, tf("odom", "base_link", ODOM_BASE))
    assert bench.cloud()
    bench.gateway.tick()
    assert not bench.of(Output.TF)


def test_the_status_comes_once_a_second_and_when_it_changes():
    bench = Bench(localized)
    for _ in range(30):
        bench.gateway.tick()
        bench.now_s += 0.1
    assert len(bench.of(Output.STATUS)) == 3
    assert bench.cloud()
    (one,) = bench.of(Output.STATUS)[-1].status
    assert (one.level, one.message, one.name) == (0, "localized", "first_fix: pose in the map")
    assert bench.of(Output.STATUS)[-1].header.stamp.sec == 9


def test_messages_that_cannot_be_used_are_told_once_and_dropped(monkeypatch: pytest.MonkeyPatch):
    bench = Bench(localized)
    for kind in (Input.IMU, Input.TF, Input.TF_STATIC, Input.OWN_POSE):
        bench.gateway.take(kind, b"x")
        bench.gateway.take(kind, b"x")
    assert [line.partition(":")[0] for line in bench.told] == [
        "Imu",
        "TFMessage",
        "PoseWithCovarianceStamped",
    ]
    monkeypatch.setattr(module, "MAX_CLOUD_BYTES", 50)
    assert not bench.cloud()
    assert "the limit is 50" in bench.told[-1]


def test_it_listens_only_while_it_needs_to():
    assert Bench(localized, at_start=False).gateway.needs == frozenset()
    assert Input.CLOUD in Bench(localized).gateway.needs
    watching = Bench(localized, watch_s=60.0)
    assert watching.cloud()
    assert Input.CLOUD not in watching.gateway.needs
    assert Input.TF in watching.gateway.needs
    watching.now_s += 58.5
    assert Input.CLOUD in watching.gateway.needs


@pytest.mark.parametrize(
    "wrong",
    [{"map_frame": ""}, {"retry_s": -1.0}, {"watch_s": np.nan}, {"astray_m": 0.0}, {"prior_radius_m": 0.5}],
)
def test_a_configuration_that_cannot_be(wrong: dict[str, Any]):
    with pytest.raises(InvalidOption):
        GatewayConfig(**wrong)
