"""Up in a room, from a sensor in any orientation: one of the hypotheses is always right."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.scan.levelling import MAX_TILT_DEG, estimate_up, estimate_up_near
from firstfix.scan.up_hypotheses import main_axes, other_ups

WALLS_YAW_DEG = 24.0


def room(seed: int, floor: int = 300, ceiling: int = 250, walls: int = 500, clutter: int = 250) -> np.ndarray:
    """Normals of a room in its level frame, walls at WALLS_YAW_DEG, with a little noise."""
    rng = np.random.default_rng(seed)
    wall = np.zeros((walls, 3))
    wall[np.arange(walls), rng.integers(0, 2, walls)] = rng.choice([-1, 1], walls)
    wall = wall @ Rotation.from_euler("z", WALLS_YAW_DEG, degrees=True).as_matrix().T
    level = np.concatenate([np.tile([0, 0, 1.0], (floor, 1)), np.tile([0, 0, -1.0], (ceiling, 1))])
    normals = np.concatenate([level, wall, rng.normal(size=(clutter, 3))])
    normals += rng.normal(0, 0.03, normals.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def off_deg(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ other, -1, 1))))


@pytest.mark.parametrize("seed", range(20))
def test_one_hypothesis_is_up_whatever_the_orientation(seed):
    R_sensor_level = Rotation.random(random_state=seed).as_matrix()
    normals = room(seed) @ R_sensor_level.T
    tried = estimate_up(normals)
    ups = [tried, *other_ups(normals, tried, None)]
    assert min(off_deg(up, R_sensor_level[:, 2]) for up in ups) < 0.5
    assert len(ups) <= 8  # the tried one, its opposite, and both ways along three axes: none of them twice
    assert all(off_deg(a, b) > 9 for n, a in enumerate(ups) for b in ups[:n])


@pytest.mark.parametrize("seed", range(10))
def test_up_is_found_where_level_directions_outvote_it(seed):
    """In a garage: rough floor and ceiling, few walls. What is uneven by 6 degrees is still level."""
    R_sensor_level = Rotation.random(random_state=seed).as_matrix()
    normals = room(seed, floor=250, ceiling=220, walls=120, clutter=400)
    normals += np.random.default_rng(seed).normal(0, 0.1, normals.shape)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) @ R_sensor_level.T
    tried = estimate_up(normals)
    ups = [tried, *other_ups(normals, tried, None)]
    assert min(off_deg(one, R_sensor_level[:, 2]) for one in ups) < 2.0
    assert len(ups) <= 10  # and both ways along the one at right angles to three in a plane


@pytest.mark.parametrize("mounted", [[180, 0], [0, 180], [90, 0], [0, -90], [135, 20]])
def test_up_is_found_near_where_the_mounting_has_it(mounted):
    R_base_sensor = Rotation.from_euler("XY", mounted, degrees=True).as_matrix()
    R_level_base = Rotation.from_euler("xy", [8, -11], degrees=True).as_matrix()
    R_level_sensor = R_level_base @ R_base_sensor
    up = estimate_up_near(room(3) @ R_level_sensor, R_base_sensor[2])
    assert off_deg(up, R_level_sensor[2]) < 0.5


def test_where_up_is_expected_along_z_nothing_changes_to_the_last_bit():
    normals = np.ascontiguousarray(room(5), np.float32)
    assert np.array_equal(estimate_up_near(normals, np.array([0.0, 0.0, 1.0])), estimate_up(normals))


def test_open_ground_leaves_its_normal_and_the_opposite():
    """With hardly any upright surface, head down is tried, and no direction without support."""
    normals = room(1, floor=900, ceiling=0, walls=0, clutter=60)
    tried = estimate_up(normals)
    ups = other_ups(normals, tried, None)
    assert off_deg(ups[0], -tried) < 1e-3
    assert len(ups) <= 5


def test_axes_that_are_few_votes_are_none():
    slanted = Rotation.from_euler("x", 40, degrees=True).as_matrix()
    normals = np.concatenate([room(2, clutter=0), np.tile(slanted[:, 2], (60, 1))])
    axes = main_axes(normals)
    assert len(axes) == 3
    assert all(abs(axis @ slanted[:, 2]) < np.cos(np.radians(10)) for axis in axes)


def test_gravity_leaves_itself_and_what_the_surfaces_say_beside_it():
    R_sensor_level = Rotation.from_euler("x", 150, degrees=True).as_matrix()
    normals = room(7) @ R_sensor_level.T
    shaken = Rotation.from_euler("y", 6, degrees=True).as_matrix() @ R_sensor_level[:, 2]
    (by_surfaces,) = other_ups(normals, shaken, -9.8 * shaken)
    assert off_deg(by_surfaces, R_sensor_level[:, 2]) < 0.5
    upright_by_mistake = estimate_up(normals)
    assert off_deg(upright_by_mistake, R_sensor_level[:, 2]) > MAX_TILT_DEG
    first, second = other_ups(normals, upright_by_mistake, -9.8 * shaken)
    assert off_deg(first, shaken) < 1e-3
    assert off_deg(second, R_sensor_level[:, 2]) < 0.5


def test_gravity_that_the_surfaces_confirm_leaves_nothing_to_try():
    normals = room(9)
    assert other_ups(normals, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -9.8])) == []
