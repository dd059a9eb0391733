"""Messages beside the cloud, against rosbags: gravity from an IMU, fixed frames, and the pose."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.errors import InputError, MalformedData, NotFound
from firstfix.ros.header import Header, Stamp
from firstfix.ros.imu import GravityWindow, ImuSample, decode_imu, down_of
from firstfix.ros.pose_message import TYPE, covariance_of_base, to_pose_cdr
from firstfix.ros.static_transforms import StaticTransforms, decode_transforms
from firstfix.transform import from_quaternion, inverse, make_transform, rotation_z
from tests import ros_samples
from tests.every_case import every_case
from tests.ros_samples import ROS1, ROS2, cdr

UP = np.array([0.2, -0.1, 0.97]) / np.linalg.norm([0.2, -0.1, 0.97])
S = 10**9


def check_truncations(body: bytes, decode: Callable[[bytes], object]) -> None:
    for end in range(len(body)):
        with pytest.raises(InputError):
            decode(body[:end])


def sample(stamp_ns: int, acceleration: np.ndarray, frame_id: str = "imu") -> ImuSample:
    return ImuSample(Header(Stamp.of_ns(stamp_ns), frame_id), acceleration)


@every_case("ros1", [False, True])
@every_case("little_endian", [True, False])
def test_an_imu_message_of_rosbags_is_read(ros1, little_endian):
    if ros1:
        body = ros_samples.ros1(ros_samples.imu([1.5, -2.5, 9.0], stores=ROS1, stamp_ns=7))
    else:
        body = cdr(ros_samples.imu([1.5, -2.5, 9.0], stamp_ns=7), little_endian=little_endian)
    read = decode_imu(body, ros1=ros1)
    assert read.acceleration.tolist() == [1.5, -2.5, 9.0]
    assert read.header == Header(Stamp(0, 7), "imu")
    check_truncations(body, lambda part: decode_imu(part, ros1=ros1))
    with pytest.raises(MalformedData):
        decode_imu(body + bytes(4), ros1=ros1)


@every_case("unit", [9.80665, 1.0])
def test_gravity_at_rest_is_against_the_specific_force(unit):
    noise = np.random.default_rng(1).normal(0, 0.02 * unit, (100, 3))
    down = down_of(UP * unit + noise)
    np.testing.assert_allclose(down, -UP, atol=0.01)
    assert np.linalg.norm(down) == pytest.approx(1)


@every_case("acceleration", [UP * 12.0, UP * 5.0, UP * 0.0, UP * np.nan])
def test_an_accelerating_imu_gives_no_gravity(acceleration):
    assert down_of([acceleration] * 10) is None


def test_no_gravity_without_samples():
    assert down_of([]) is None
    assert GravityWindow().down(Stamp(5)) is None
    assert GravityWindow().frame_id == ""


def test_only_samples_near_the_scan_count():
    window = GravityWindow()
    for number in range(40):  # 4 s, the last one of which lean
        window.add(sample(number * S // 10, 9.81 * (UP if number >= 30 else np.array([0, 0, 1.0]))))
    np.testing.assert_allclose(window.down(Stamp(3, 600_000_000)), -UP, atol=1e-9)
    assert window.down(Stamp(1)) is None, "forgotten"
    assert window.down(Stamp(60)) is None, "long ago"
    assert window.frame_id == "imu"


def test_a_clock_that_is_set_back_begins_anew():
    window = GravityWindow()
    window.add(sample(100 * S, 9.81 * np.array([0, 0, 1.0])))
    window.add(sample(5 * S, 9.81 * UP))
    np.testing.assert_allclose(window.down(Stamp(5)), -UP)


def test_a_sample_that_comes_late_does_not_begin_anew():
    window = GravityWindow()
    for tenth in (0, 1, 3, 2, 4):  # as several threads of a driver send them
        lean = np.array([0.0, 0.0, 1.0]) if tenth == 2 else UP
        window.add(sample(5 * S + tenth * S // 10, 9.81 * lean))
    expected = -(4 * UP + np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(window.down(Stamp(5, 200_000_000)), expected / np.linalg.norm(expected))


BASE_MAST = from_quaternion([0.1, 0.2, 1.0], [0, 0, 0.3, 0.9])
MAST_LIDAR = from_quaternion([0.0, 0.0, 0.4], [0.1, 0, 0, 0.9])
BASE_IMU = from_quaternion([-0.3, 0.0, 0.2], [0, 0.7, 0, 0.7])
TREE = [("base_link", "mast", BASE_MAST), ("mast", "lidar", MAST_LIDAR), ("base_link", "imu", BASE_IMU)]


@pytest.fixture
def frames() -> StaticTransforms:
    known = StaticTransforms()
    for one in TREE:  # as several nodes send them
        known.add(decode_transforms(cdr(ros_samples.transforms([one]))))
    return known


def test_frames_are_joined_along_every_way(frames):
    np.testing.assert_allclose(frames.between("base_link", "lidar"), BASE_MAST @ MAST_LIDAR, atol=1e-12)
    np.testing.assert_allclose(
        frames.between("lidar", "imu"), inverse(BASE_MAST @ MAST_LIDAR) @ BASE_IMU, atol=1e-12
    )
    np.testing.assert_array_equal(frames.between("lidar", "lidar"), np.eye(4))
    np.testing.assert_array_equal(frames.between("/imu", "imu"), np.eye(4))


def test_unconnected_frames_are_named(frames):
    with pytest.raises(NotFound, match="'lidar' and 'camera': they hang on 'base_link' and 'camera'"):
        frames.between("lidar", "camera")


def test_a_circle_of_frames_is_refused():
    known = StaticTransforms()
    known.add({"a": ("b", np.eye(4)), "b": ("a", np.eye(4))})
    for source in ("a", "b"):
        with pytest.raises(NotFound, match="in a circle"):
            known.between("c", source)


def test_ros1_transforms_are_read():
    body = ros_samples.ros1(ros_samples.transforms(TREE, stores=ROS1))
    parent, T = decode_transforms(body, ros1=True)["lidar"]
    assert parent == "mast"
    np.testing.assert_allclose(T, MAST_LIDAR, atol=1e-12)


def test_truncated_transforms_are_input_errors():
    body = cdr(ros_samples.transforms(TREE))
    check_truncations(body, decode_transforms)
    with pytest.raises(MalformedData, match="the limit is 1000"):
        decode_transforms(body[:4] + b"\xff\xff\xff\xff" + body[8:])


@pytest.mark.parametrize(
    ("field", "name", "value", "says"),
    [("rotation", "w", 0.0, "no direction"), ("translation", "x", np.nan, "not finite")],
)
def test_an_invalid_transform_is_malformed(field, name, value, says):
    message = ros_samples.transforms([("base_link", "mast", np.eye(4))])
    setattr(getattr(message.transforms[0].transform, field), name, value)
    with pytest.raises(MalformedData, match=says):
        decode_transforms(cdr(message))


def test_the_last_of_two_mountings_counts_or_neither():
    moved = BASE_MAST.copy()
    moved[0, 3] += 0.01
    for strict in (False, True):
        known = StaticTransforms(strict=strict)
        for one in (*TREE, ("base_link", "mast", moved), ("elsewhere", "imu", np.eye(4))):
            known.add(decode_transforms(cdr(ros_samples.transforms([one]))))
        if not strict:
            np.testing.assert_allclose(known.between("base_link", "lidar"), moved @ MAST_LIDAR, atol=1e-12)
            continue
        for child, parents in (("lidar", ("base_link", "base_link")), ("imu", ("base_link", "elsewhere"))):
            mounted = "mast" if child == "lidar" else child
            says = f"'{mounted}' is mounted in two ways, on '{parents[0]}' and on '{parents[1]}'"
            with pytest.raises(MalformedData, match=says):
                known.between(parents[1], child)
        # Below the disputed frame nothing is in doubt.
        np.testing.assert_allclose(known.between("mast", "lidar"), MAST_LIDAR, atol=1e-12)


def test_a_transform_that_is_sent_again_is_not_disputed(frames):
    known = StaticTransforms(strict=True)
    nearly = MAST_LIDAR.copy()
    nearly[:3, 3] += 1e-7
    for one in (*TREE, *TREE, ("mast", "lidar", nearly)):
        known.add(decode_transforms(cdr(ros_samples.transforms([one]))))
    np.testing.assert_allclose(known.between("lidar", "imu"), frames.between("lidar", "imu"), atol=1e-6)


T_MAP_SENSOR = from_quaternion([12.5, -4.25, 1.75], [0.1, -0.2, 0.3, 0.9])
T_BASE_SENSOR = make_transform(rotation_z(0.4), [0.5, -0.1, 1.2])
ROOT = np.random.default_rng(2).normal(size=(6, 6)) * [0.02, 0.03, 0.01, 0.004, 0.002, 0.006]
COVARIANCE = ROOT.T @ ROOT


def localized(T_map_base: np.ndarray | None = None) -> Localization:
    return Localization(Verdict.LOCALIZED, (), T_MAP_SENSOR, T_map_base, COVARIANCE, 0.99)


@every_case("frame_id", ["map", "a", "hall/floor_2", "wände"])
def test_rosbags_reads_the_message_and_writes_the_same_bytes(frame_id):
    body = to_pose_cdr(localized(), Stamp(1_700_000_000, 250_000_001), frame_id)
    message = ROS2.deserialize_cdr(body, TYPE)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 250_000_001)
    assert message.header.frame_id == frame_id
    pose = message.pose.pose
    position, q = pose.position, pose.orientation
    T = from_quaternion([position.x, position.y, position.z], [q.x, q.y, q.z, q.w])
    np.testing.assert_allclose(T, T_MAP_SENSOR, atol=1e-12)
    np.testing.assert_array_equal(message.pose.covariance, COVARIANCE.ravel())
    assert bytes(ROS2.serialize_cdr(message, TYPE)) == body


def test_a_message_with_a_mounting_has_the_robots_pose():
    T_map_base = T_MAP_SENSOR @ inverse(T_BASE_SENSOR)
    message = ROS2.deserialize_cdr(to_pose_cdr(localized(T_map_base), Stamp()), TYPE)
    position = message.pose.pose.position
    np.testing.assert_allclose([position.x, position.y, position.z], T_map_base[:3, 3])
    moved = covariance_of_base(T_MAP_SENSOR, T_map_base, COVARIANCE)
    np.testing.assert_array_equal(message.pose.covariance.reshape(6, 6), moved)
    assert message.header.frame_id == "map"


def test_the_robots_covariance_is_that_of_sampled_poses():
    rng = np.random.default_rng(5)
    T_map_base = T_MAP_SENSOR @ inverse(T_BASE_SENSOR)
    draws = rng.multivariate_normal(np.zeros(6), COVARIANCE, 20_000)
    arm = T_map_base[:3, 3] - T_MAP_SENSOR[:3, 3]
    moves = draws[:, :3] + np.cross(draws[:, 3:], arm)  # turns are small: first order
    sampled = np.cov(np.hstack([moves, draws[:, 3:]]).T)
    expected = covariance_of_base(T_MAP_SENSOR, T_map_base, COVARIANCE)
    np.testing.assert_allclose(sampled, expected, atol=0.04 * np.abs(expected).max())
    assert np.abs(expected - COVARIANCE).max() > 0.05 * np.abs(expected).max(), "the arm matters"


def test_the_order_is_x_y_z_then_turns_about_x_y_z():
    spread = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    answer = Localization(Verdict.LOCALIZED, (), np.eye(4), None, spread, 0.99)
    message = ROS2.deserialize_cdr(to_pose_cdr(answer, Stamp()), TYPE)
    assert [message.pose.covariance[i] for i in (0, 7, 14, 21, 28, 35)] == [1, 2, 3, 4, 5, 6]


def test_an_answer_without_a_pose_has_no_message():
    with pytest.raises(ValueError, match="only a localized answer"):
        to_pose_cdr(Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)), Stamp())


def test_the_golden_bytes_of_the_protocols_page():
    page = (Path(__file__).resolve().parents[3] / "clients" / "protocol" / "ros.md").read_text()
    example = page[page.index("A golden pose") :]
    stated = "".join(re.findall(r"\b(?:[0-9a-f]{8}|[0-9a-f]{16})\b", example.partition("36 times")[0]))
    T = make_transform(np.eye(3), [1, 2, 3])
    answer = Localization(Verdict.LOCALIZED, (), T, None, np.zeros((6, 6)), 1.0)
    body = to_pose_cdr(answer, Stamp(5, 7))
    assert body == bytes.fromhex(stated) + bytes(36 * 8)
    assert f"{len(body)} bytes" in example
