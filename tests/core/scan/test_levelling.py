"""Up and the floor in a scan: the first estimate, and other hypotheses in any orientation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix import native
from firstfix.scan.levelling import (
    MAX_TILT_DEG,
    estimate_up,
    estimate_up_near,
    floor_height,
    levelling_rotation,
    turned,
)
from firstfix.transform import rotation_between
from tests.reference import up_hypotheses as reference

WALLS_YAW_DEG = 24.0


def other_ups(normals: np.ndarray, known: np.ndarray, gravity: np.ndarray | None) -> list[np.ndarray]:
    """The compiled hypotheses, which are those of the reference."""
    single = normals.astype(np.float32)
    found, wanted = native.other_ups(single, known, gravity), reference.other_ups(single, known, gravity)
    assert len(found) == len(wanted)
    for mine, its in zip(found, wanted, strict=True):
        np.testing.assert_allclose(mine, its, rtol=0, atol=1e-9)
    return list(found)


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


def test_an_expected_up_along_z_changes_no_bit():
    normals = np.ascontiguousarray(room(5), np.float32)
    assert np.array_equal(estimate_up_near(normals, np.array([0.0, 0.0, 1.0])), estimate_up(normals))


def test_open_ground_leaves_its_normal_and_the_opposite():
    """With hardly any upright surface, head down is tried, and no direction without support."""
    normals = room(1, floor=900, ceiling=0, walls=0, clutter=60)
    tried = estimate_up(normals)
    ups = other_ups(normals, tried, None)
    assert off_deg(ups[0], -tried) < 1e-3
    assert len(ups) <= 5


def test_directions_of_few_votes_are_no_axes():
    slanted = Rotation.from_euler("x", 40, degrees=True).as_matrix()
    normals = np.concatenate([room(2, clutter=0), np.tile(slanted[:, 2], (60, 1))])
    axes = reference.main_axes(normals)
    assert len(axes) == 3
    assert all(abs(axis @ slanted[:, 2]) < np.cos(np.radians(10)) for axis in axes)


def test_gravity_leaves_itself_and_the_up_of_the_surfaces():
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


def test_confirmed_gravity_leaves_nothing_to_try():
    normals = room(9)
    assert other_ups(normals, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -9.8])) == []


@pytest.mark.parametrize("tilt_deg", [0, 3, 10, 20, 30])
@pytest.mark.parametrize("seed", range(3))
def test_up_is_found_under_any_tilt(tilt_deg, seed):
    rng = np.random.default_rng(seed)
    axis = [np.cos(a := rng.uniform(0, 7)), np.sin(a), 0]
    R_sensor_level = Rotation.from_rotvec(np.radians(tilt_deg) * np.array(axis)).as_matrix()
    up = estimate_up(room(seed, ceiling=0) @ R_sensor_level.T)
    assert off_deg(up, R_sensor_level[:, 2]) < 0.5


def test_walls_alone_give_up():
    R = Rotation.from_euler("XY", [12, -7], degrees=True).as_matrix()
    up = estimate_up(room(1, floor=0, ceiling=0, walls=900, clutter=200) @ R.T)
    assert off_deg(up, R[:, 2]) < 1.0


def test_one_wall_alone_stays_near_upright():
    normals = np.tile([1.0, 0, 0], (500, 1))
    up = estimate_up(normals)
    assert up[2] > np.cos(np.radians(10))


def room_points(height_m: float, table: bool) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(-8, 8, (600, 2)), np.full(600, -height_m)])
    wall = np.column_stack([np.full(400, 8.0), rng.uniform(-8, 8, 400), rng.uniform(-height_m, 2, 400)])
    points, normals = [floor, wall], [np.tile([0, 0, 1.0], (600, 1)), np.tile([1.0, 0, 0], (400, 1))]
    if table:
        top = np.column_stack([rng.uniform(1, 3, (500, 2)), np.full(500, -height_m + 0.75)])
        points.append(top)
        normals.append(np.tile([0, 0, 1.0], (500, 1)))
    cloud = np.concatenate(points) + rng.normal(0, 0.01, (sum(map(len, points)), 3))
    return cloud, np.concatenate(normals)


@pytest.mark.parametrize("height_m", [0.4, 1.0, 1.73, 2.5])
@pytest.mark.parametrize("table", [False, True])
def test_the_floor_is_the_lowest_level_surface_not_the_table(height_m, table):
    assert floor_height(*room_points(height_m, table)) == pytest.approx(height_m, abs=0.03)


def test_a_table_is_not_the_floor_where_walls_reach_further_down():
    points, normals = room_points(1.0, table=True)
    above = points[:, 2] > -0.7  # a sensor that looks down a few degrees
    assert floor_height(points[above], normals[above]) is None


def test_a_few_points_below_the_floor_do_not_hide_it():
    points, normals = room_points(1.0, table=False)
    wall = np.flatnonzero(np.abs(normals[:, 2]) < 0.5)
    points[wall[:10], 2] = -1.5  # reflections, stairs
    assert floor_height(points, normals) == pytest.approx(1.0, abs=0.03)


def test_a_scan_without_a_floor_has_no_height():
    rng = np.random.default_rng(0)
    points = rng.uniform([-8, -8, 0], [8, 8, 3], (500, 3))
    assert floor_height(points, np.tile([1.0, 0, 0], (500, 1))) is None


def test_a_floor_just_below_the_sensor_is_found():
    points = np.column_stack([np.tile([1.0, 2.0], 20), np.zeros(40), np.full(40, -0.07)])
    assert floor_height(points, np.tile([0.0, 0.0, 1.0], (40, 1))) == pytest.approx(0.07)


@pytest.mark.parametrize("up", [[0, 0, 2], [0.1, -0.3, 0.9], [-1, 0, 0], [0, 0.5, -0.9], [0, 0, -1]])
def test_the_levelling_rotation_is_the_smallest(up):
    R = levelling_rotation(np.array(up, np.float64))
    np.testing.assert_allclose(R, rotation_between(up, [0, 0, 1]), atol=1e-7)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-7)


def test_turned_is_the_matrix_product():
    points = np.random.default_rng(3).normal(size=(50, 3)).astype(np.float32)
    R = levelling_rotation(np.array([0.2, 0.1, 0.9]))
    assert turned(points, R).dtype == np.float32
    np.testing.assert_allclose(turned(points, R), points @ R.T, atol=1e-5)
