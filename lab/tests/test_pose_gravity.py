"""The gravity that an IMU would measure at a known pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.transform import make_transform
from firstfix_lab.evaluation.pose_gravity import gravity_at, imu_errors

HANGING = make_transform(Rotation.from_euler("zx", [40, 170], degrees=True).as_matrix(), [3, 4, 5])


def test_without_noise_it_is_down_in_the_sensor_frame():
    (error,) = imu_errors(1, 0.0)
    np.testing.assert_allclose(HANGING[:3, :3] @ gravity_at(HANGING, error), [0, 0, -1], atol=1e-12)


@pytest.mark.parametrize("noise_deg", [1.0, 5.0])
def test_roll_and_pitch_are_off_by_the_noise(noise_deg):
    down = np.array([gravity_at(HANGING, error) for error in imu_errors(4000, noise_deg)])
    np.testing.assert_allclose(np.linalg.norm(down, axis=1), 1)
    off_deg = np.degrees(np.arccos(-(down @ HANGING[:3, :3].T)[:, 2]))
    assert np.sqrt(np.mean(off_deg**2)) == pytest.approx(np.sqrt(2) * noise_deg, rel=0.05)


def test_the_noise_is_the_same_in_every_run():
    assert np.array_equal(imu_errors(5, 2.0), imu_errors(5, 2.0))


def test_without_an_imu_or_a_pose_there_is_none():
    assert list(imu_errors(3, None)) == [None] * 3
    assert gravity_at(None, np.zeros(2)) is None
