"""Scans in motion: where their rays hit, their times, and that the motion is solved back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from firstfix.builds.config import PerturbConfig
from firstfix.engine.config import PreprocessConfig, RegistrationConfig
from firstfix.engine.preprocess import preprocess
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.native import deskew
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.sensor import preset
from firstfix.transform import make_transform, pose_error, rotation_z
from firstfix_builder.simulation.moving import Motion, Sweep, moving_ranges, poses_along
from firstfix_builder.simulation.perturb import ScanCase, ScanSimulation
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import SmallWorld

CLEAN = PerturbConfig(noise_m=0, dropout=0, occluders=0, strangers=0)
NOISY = PerturbConfig(noise_m=0.02, dropout=0.05, occluders=0, strangers=0)
SENSOR = preset("vlp-16")
NOWHERE = np.empty((0, 3))
HERE = make_transform(rotation_z(0.4), [-1.0, 0.5, 0.8])
MOTIONS = {
    "straight": (1.5, 0.0, 0.0, 0.0, 0.0, 0.0),
    "curve": (1.0, -0.3, 0.0, 0.0, 0.0, -1.0),
    "spin": (0.0, 0.0, 0.0, 0.0, 0.0, 2.0),
    "drive": (8.0, 0.0, 0.0, 0.0, 0.0, 0.3),
}


@pytest.fixture(scope="module")
def simulator(small_world: SmallWorld) -> Simulator:
    return Simulator(small_world.vertices, small_world.triangles)


@pytest.fixture(scope="module")
def surface(simulator: Simulator) -> MapSurface:
    """Map of still, clean scans from places all around."""
    seen = []
    for x in np.arange(-6.5, 7, 1.3):
        for y in np.arange(-4.5, 5, 1.3):
            T = make_transform(np.eye(3), [x, y, 1.0])
            if simulator.is_free(T[None, :3, 3], 0.3)[0]:
                scan = ScanSimulation(simulator, preset("os0-64"), CLEAN).scan(ScanCase(T, 0, NOWHERE))
                seen.append(Surface.around(scan.points[::7], -scan.points[::7]).moved(T))
    config = RegistrationConfig()
    return MapSurface.of(Surface.together(seen).thinned(config.map_voxel_m), config)


def scan_of(simulator: Simulator, twist, config=NOISY, sweep: Sweep = Sweep()) -> Scan:
    return ScanSimulation(simulator, SENSOR, config).scan(ScanCase(HERE, 5, NOWHERE), Motion(twist, sweep))


def test_poses_are_the_exponential_of_the_twist():
    twist = np.array([1.0, -2.0, 0.3, 0.4, -0.2, 1.5])
    (vx, vy, vz), (x, y, z) = twist[:3], twist[3:]
    matrix = np.array([[0, -z, y, vx], [z, 0, -x, vy], [-y, x, 0, vz], [0, 0, 0, 0]])
    R, t = poses_along(twist, np.array([-0.1, 0.0, 1e-9, 0.04]))
    for number, time_s in enumerate((-0.1, 0.0, 1e-9, 0.04)):
        wanted = expm(matrix * time_s)
        np.testing.assert_allclose(R[number], wanted[:3, :3], atol=1e-9)
        np.testing.assert_allclose(t[number], wanted[:3, 3], atol=1e-9)


def test_times_begin_and_end_at_the_cut():
    ahead, left, behind_left = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 1e-4, 0]])
    assert Sweep().times(np.array([ahead]))[0] == pytest.approx(0, abs=1e-6)
    assert Sweep().times(np.array([left]))[0] == pytest.approx(-0.025)  # clockwise: the left is seen before
    assert Sweep(clockwise=False).times(np.array([left]))[0] == pytest.approx(0.025)
    assert Sweep(stamp=0.0).times(np.array([behind_left]))[0] == pytest.approx(0, abs=1e-5)
    assert Sweep(period_s=0.05, stamp=1.0).times(np.array([ahead]))[0] == pytest.approx(-0.025)


def test_a_sensor_at_rest_sees_what_it_sees_at_once(simulator):
    moving = moving_ranges(simulator, SENSOR, HERE, Motion((0.0,) * 6), Rays.of_sensor(SENSOR))
    still = next(simulator.ranges(HERE[None], SENSOR))[0]
    assert np.array_equal(np.isfinite(moving), np.isfinite(still))
    seen = np.isfinite(still)
    assert np.quantile(np.abs(moving[seen] - still[seen]), 0.999) < 1e-3  # rays that graze an edge aside


@pytest.mark.parametrize("name", list(MOTIONS))
def test_a_deskewed_scan_lies_on_the_surfaces(simulator, name):
    """The simulator and the kernel were written apart, and agree."""
    scan = scan_of(simulator, MOTIONS[name], CLEAN)
    skewed = scan.points @ HERE[:3, :3].T + HERE[:3, 3]
    still = deskew(scan.points, scan.time_s, np.array(MOTIONS[name])) @ HERE[:3, :3].T + HERE[:3, 3]
    assert simulator.distance(still).max() < 1e-4
    assert np.quantile(simulator.distance(skewed), 0.9) > 0.01


@pytest.mark.parametrize("name", list(MOTIONS))
@pytest.mark.parametrize("stamp", [0.0, 0.5])
def test_pose_and_motion_are_solved_back(simulator, surface, name, stamp):
    twist = np.array(MOTIONS[name])
    scan = scan_of(simulator, MOTIONS[name], sweep=Sweep(stamp=stamp))
    query = preprocess(ScanSequence.single(scan), None, PreprocessConfig())
    start = HERE @ make_transform(Rotation.from_rotvec([0.01, -0.01, 0.03]).as_matrix(), [0.1, -0.1, 0.03])
    (found,) = surface.align_fine(query.dense, start[None])
    metres, degrees = pose_error(HERE, found.T_level_sensor)
    assert metres < 0.015
    assert degrees < 0.15
    assert np.abs(found.twist - twist)[:3].max() < 0.3
    assert np.abs(found.twist - twist)[3:].max() < 0.06
    (rigid,) = surface.align_fine(replace(query.dense, time_s=None), start[None])
    assert rigid.twist is None
    assert rigid.alignment_score < found.alignment_score - 0.02
    if stamp == 0.0:  # the rigid pose is that at the middle of the revolution
        assert pose_error(HERE, rigid.T_level_sensor)[0] > metres


def test_a_sensor_at_rest_has_no_motion_and_the_same_pose(simulator, surface):
    scan = scan_of(simulator, (0.0,) * 6)
    query = preprocess(ScanSequence.single(scan), None, PreprocessConfig())
    (found,) = surface.align_fine(query.dense, HERE[None])
    (rigid,) = surface.align_fine(replace(query.dense, time_s=None), HERE[None])
    metres, degrees = pose_error(found.T_level_sensor, rigid.T_level_sensor)
    assert metres < 0.003
    assert degrees < 0.02
    assert np.abs(found.twist[:3]).max() < 0.1
    assert np.abs(found.twist[3:]).max() < 0.03
    assert abs(found.alignment_score - rigid.alignment_score) < 0.01
    # the motion is not known beforehand, so the pose is a little less certain
    assert np.linalg.det(found.information) < np.linalg.det(rigid.information)
