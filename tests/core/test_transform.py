import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from firstfix import transform as tf

angles = st.floats(-np.pi, np.pi)
SETTLED = 1e-9


@given(angles, angles, angles)
def test_quaternions_agree_with_scipy_both_ways(a, b, c):
    R = Rotation.from_euler("ZYX", [a, b, c])
    T = tf.from_quaternion([1, 2, 3], R.as_quat())
    assert np.allclose(T[:3, :3], R.as_matrix(), atol=SETTLED)
    assert np.allclose(
        tf.from_quaternion([0, 0, 0], tf.quaternion_of(T))[:3, :3], R.as_matrix(), atol=SETTLED
    )


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_half_turns_keep_their_quaternion(axis):
    R = Rotation.from_euler(axis, np.pi).as_matrix()
    q = tf.quaternion_of(tf.make_transform(R, [0, 0, 0]))
    assert np.allclose(Rotation.from_quat(q).as_matrix(), R, atol=SETTLED)


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 0], [0, 0, 1e231, 1]])
def test_a_quaternion_without_direction_is_refused(quaternion):
    with pytest.raises(ValueError, match="no direction"):
        tf.from_quaternion([0, 0, 0], quaternion)


@given(angles, angles, angles)
def test_inverse_undoes(a, b, c):
    T = tf.make_transform(Rotation.from_euler("ZYX", [a, b, c]).as_matrix(), [3, -2, 7])
    assert np.allclose(tf.inverse(T) @ T, np.eye(4), atol=SETTLED)
    points = np.array([[1.0, 2, 3], [-4, 5, 6]])
    assert np.allclose(tf.transform_points(tf.inverse(T), tf.transform_points(T, points)), points)


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(directions, directions)
def test_rotation_between_turns_one_onto_the_other(a, b):
    R = tf.rotation_between(a, b)
    assert np.allclose(R @ np.array(a) / np.linalg.norm(a), np.array(b) / np.linalg.norm(b), atol=1e-6)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(R) == pytest.approx(1)


def test_rotation_between_opposites():
    assert np.allclose(tf.rotation_between([0, 0, 1], [0, 0, -1]) @ [0, 0, 1], [0, 0, -1])


@pytest.mark.parametrize("angle_deg", [0, 1e-5, 0.1, 45, 179.999, 180])
def test_pose_error_measures_small_and_large_angles(angle_deg):
    T = tf.make_transform(Rotation.from_euler("y", angle_deg, degrees=True).as_matrix(), [3, 0, 4])
    error_m, error_deg = tf.pose_error(np.eye(4), T)
    assert error_m == pytest.approx(5)
    assert error_deg == pytest.approx(angle_deg, abs=1e-6)
