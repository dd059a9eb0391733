"""Fixed frames: against rosbags' bytes, along every way through the tree."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, NotFound
from firstfix.ros.static_transforms import StaticTransforms, decode_transforms
from firstfix.transform import from_quaternion, inverse
from tests import ros_samples
from tests.ros_samples import ROS1, cdr

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
    for end in range(len(body)):
        with pytest.raises(InputError):
            decode_transforms(body[:end])
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
