"""Covariance of answered poses: known geometry, any information, and errors of aligned scans."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from firstfix.answer.free_direction import Motion
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.transform import make_transform, rotation_z
from tests.reference.facing import faced_information, principal_axes, told
from tests.reference.verdict_in_steps import faced_information as faced_at
from tests.reference.verdict_in_steps import free_directions, pose_covariance

CONFIG = RegistrationConfig(map_voxel_m=0.1, coarse_voxel_m=0.5, fine_distance_m=0.4, inlier_distance_m=0.13)
TURNED = make_transform(Rotation.from_euler("zyx", [0.7, 0.1, -0.2]).as_matrix(), [100, -50, 3])
SCATTER_RAD = 0.07  # of normals: 4 degrees


def plane(normal: list[float], at_m: float, half_m: tuple[float, float], seed: int = 0) -> np.ndarray:
    """(n, 6) arms and normals of pairs on a plane. The normals scatter."""
    rng = np.random.default_rng(seed)
    n = np.array(normal, float)
    u, v = np.eye(3)[:2] if n[2] else np.array([np.cross([0, 0, 1], n), [0, 0, 1]])
    along = rng.uniform(-1, 1, (1000, 2)) * half_m
    arms = at_m * n + along[:, :1] * u + along[:, 1:] * v
    normals = n + rng.normal(0, SCATTER_RAD, (1000, 3))
    return np.column_stack([arms, normals / np.linalg.norm(normals, axis=1)[:, None]])


def information(*planes: np.ndarray, sigma_m: float = 0.02) -> np.ndarray:
    arms, normals = np.split(np.concatenate(planes), 2, axis=1)
    J = np.column_stack([np.cross(arms, normals), normals]) / sigma_m
    return faced_by(J.T @ J, arms, normals)


def faced_by(whole: np.ndarray, arms: np.ndarray, normals: np.ndarray) -> np.ndarray:
    axes = principal_axes(whole)
    return faced_information(whole, axes, *told(arms, normals, np.zeros(len(arms)), axes, 0.4))


FLOOR = plane([0, 0, 1], -1.0, (20.0, 1.5), 1)
WALLS = plane([0, 1, 0], 1.5, (20.0, 1.4), 2), plane([0, -1, 0], 1.5, (20.0, 1.4), 3)
ENDS = plane([1, 0, 0], 6.0, (1.5, 1.4), 4), plane([-1, 0, 0], 6.0, (1.5, 1.4), 5)
FIELD = plane([0, 0, 1], -1.0, (30.0, 30.0), 6)


@pytest.mark.parametrize("T_map_level", [np.eye(4), TURNED], ids=["level", "turned"])
def test_a_bare_corridor_is_free_along_it_in_the_frame_of_the_map(T_map_level):
    covariance = pose_covariance(information(FLOOR, *WALLS), T_map_level, CONFIG)
    (free,) = free_directions(covariance)
    assert free.motion is Motion.TRANSLATION
    assert abs(free.direction @ T_map_level[:3, 0]) == pytest.approx(1, abs=1e-4)
    assert 1 < free.sigma < 3
    across = T_map_level[:3, 1]
    assert np.sqrt(across @ covariance[:3, :3] @ across) < 0.02


def test_a_closed_room_is_free_nowhere():
    covariance = pose_covariance(information(FLOOR, *WALLS, *ENDS), np.eye(4), CONFIG)
    assert free_directions(covariance) == ()
    assert np.sqrt(np.diag(covariance)[:3]).max() < 0.02


def test_few_pairs_along_a_corridor_fix_it():
    some_end = ENDS[0][:30]
    covariance = pose_covariance(information(FLOOR, *WALLS, some_end), np.eye(4), CONFIG)
    assert free_directions(covariance) == ()


def test_an_open_field_is_free_to_both_sides_and_about_the_vertical():
    first, second, turn = free_directions(pose_covariance(information(FIELD), np.eye(4), CONFIG))
    assert [one.motion for one in (first, second, turn)] == [Motion.TRANSLATION] * 2 + [Motion.ROTATION]
    for one in (first, second):
        assert abs(one.direction[2]) < 0.05
    assert turn.direction[2] == pytest.approx(1, abs=0.01)


def test_more_points_do_not_fix_a_free_direction():
    few, many = (
        pose_covariance(count * information(FLOOR, *WALLS), np.eye(4), CONFIG)[0, 0] for count in (1, 100)
    )
    assert many == pytest.approx(few, rel=0.05)


def test_information_of_surfaces_that_truly_face_is_kept():
    arms, normals = np.split(np.concatenate([FLOOR, *WALLS, *ENDS]), 2, axis=1)
    J = np.column_stack([np.cross(arms, normals), normals])
    whole = J.T @ J
    faced = faced_by(whole, arms, normals)
    assert np.linalg.eigvalsh(whole - faced).min() > -1e-6 * np.trace(whole)  # never more than there is
    np.testing.assert_allclose(np.diag(faced), np.diag(whole), rtol=0.1)


def test_without_information_the_place_alone_is_known():
    covariance = pose_covariance(np.zeros((6, 6)), TURNED, CONFIG)
    assert len(free_directions(covariance)) == 6
    assert np.sqrt(np.diag(covariance)) == pytest.approx([2.0] * 3 + [np.radians(20)] * 3, rel=1e-3)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 8), st.floats(-6, 9), st.floats(-3, 3))
def test_a_covariance_is_symmetric_and_positive(seed, rank, exponent, apart):
    """Whatever the information: of any rank, any size, and with turns of any size beside shifts."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(rank, 6)) * np.repeat([10.0**apart, 1.0], 3)
    T_map_level = make_transform(Rotation.random(random_state=seed % 1000).as_matrix(), np.zeros(3))
    covariance = pose_covariance(10.0**exponent * J.T @ J, T_map_level, CONFIG)
    assert np.array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert np.sqrt(np.diag(covariance)[:3]).max() < 2.1
    for free in free_directions(covariance):
        assert np.linalg.norm(free.direction) == pytest.approx(1)


def grid(u: np.ndarray, v: np.ndarray, origin: list[float], step_m: float = 0.09) -> np.ndarray:
    a, b = (np.arange(0, np.linalg.norm(axis), step_m) for axis in (u, v))
    unit = [axis / np.linalg.norm(axis) for axis in (u, v)]
    return np.array(origin) + (a[:, None, None] * unit[0] + b[None, :, None] * unit[1]).reshape(-1, 3)


X, Y, Z = np.eye(3)
CORRIDOR = [
    grid(60 * X, 3 * Y, [0, 0, 0]),
    grid(60 * X, 2.8 * Z, [0, 0, 0]),
    grid(60 * X, 2.8 * Z, [0, 3, 0]),
]
ROOM = [
    grid(12 * X, 7 * Y, [0, 0, 0]),
    *(grid(12 * X, 2.8 * Z, [0, y, 0]) for y in (0.0, 7.0)),
    *(grid(7 * Y, 2.8 * Z, [x, 0, 0]) for x in (0.0, 12.0)),
]


@pytest.mark.parametrize(
    ("world", "centre", "free"),
    [(CORRIDOR, [30, 1.5, 1], 1), (ROOM, [6, 3.5, 1], 0)],
    ids=["corridor", "room"],
)
def test_a_covariance_covers_the_errors_of_aligned_scans(world, centre, free):
    """Noisy maps and noisy scans of simulated places, from starts half a metre off along x."""
    rng = np.random.default_rng(7)
    points = np.concatenate(world)
    errors = []
    for _ in range(12):
        scatter = rng.normal(0, 0.01, points.shape)
        surface = MapSurface.of(Surface.around(points + scatter), CONFIG)
        T = make_transform(rotation_z(rng.uniform(-3, 3)), centre + rng.uniform(-1, 1, 3) * [2, 0.5, 0.2])
        near = points[np.abs(points[:, 0] - T[0, 3]) < 12]
        seen = (near[rng.permutation(len(near))[:2500]] - T[:3, 3]) @ T[:3, :3]
        scan = Surface.around(seen + rng.normal(0, 0.02, seen.shape))
        start = T.copy()
        start[:3, 3] = T[:3, 3] + rng.uniform(-1, 1, 3) * [0.4, 0.1, 0.05]
        (found,) = surface.align_fine(scan, start[None])
        covariance = pose_covariance(faced_at(surface, scan, found), np.eye(4), CONFIG)
        assert [one.motion for one in free_directions(covariance)] == [Motion.TRANSLATION] * free
        off = found.T_level_sensor[:3, 3] - T[:3, 3]
        turn = Rotation.from_matrix(found.T_level_sensor[:3, :3] @ T[:3, :3].T).as_rotvec()
        errors.append(
            [off @ np.linalg.solve(covariance[:3, :3], off), turn @ np.linalg.solve(covariance[3:, 3:], turn)]
        )
    assert (np.array(errors) < 7.81).mean() >= 0.95  # the 95 % ellipsoid
    assert 0.01 < np.mean(errors) / 3 < 3
