"""The pose message, byte by byte against rosbags, and its covariance against sampled poses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.ros.header import Stamp
from firstfix.ros.pose_message import TYPE, covariance_of_base, to_pose_cdr
from firstfix.transform import from_quaternion, inverse, make_transform, rotation_z
from tests.every_case import every_case
from tests.ros_samples import ROS2

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
