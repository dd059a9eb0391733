"""Gravity out of an IMU: against rosbags' bytes, and only from one at rest."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData
from firstfix.ros.header import Header, Stamp
from firstfix.ros.imu import GravityWindow, ImuSample, decode_imu, down_of
from tests import ros_samples
from tests.every_case import every_case
from tests.ros_samples import ROS1, cdr

UP = np.array([0.2, -0.1, 0.97]) / np.linalg.norm([0.2, -0.1, 0.97])
S = 10**9


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
    for end in range(len(body)):
        with pytest.raises(InputError):
            decode_imu(body[:end], ros1=ros1)
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
