import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.scan.levelling import estimate_up, floor_height, levelling_rotation, turned
from firstfix.transform import rotation_between


def surfaces(seed: int, floor: int = 400, walls: int = 600, clutter: int = 300) -> np.ndarray:
    """Normals of a room in its level frame: floor, walls of two directions, clutter of any."""
    rng = np.random.default_rng(seed)
    wall = np.zeros((walls, 3))
    wall[np.arange(walls), rng.integers(0, 2, walls)] = rng.choice([-1, 1], walls)
    level = np.tile([0, 0, 1.0], (floor, 1))
    normals = np.concatenate([level, wall, rng.normal(size=(clutter, 3))])
    normals += rng.normal(0, 0.03, normals.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("tilt_deg", [0, 3, 10, 20, 30])
@pytest.mark.parametrize("seed", range(3))
def test_finds_up_under_any_tilt(tilt_deg, seed):
    rng = np.random.default_rng(seed)
    axis = [np.cos(a := rng.uniform(0, 7)), np.sin(a), 0]
    R_sensor_level = Rotation.from_rotvec(np.radians(tilt_deg) * np.array(axis)).as_matrix()
    up = estimate_up(surfaces(seed) @ R_sensor_level.T)
    off_deg = np.degrees(np.arccos(np.clip(up @ R_sensor_level[:, 2], -1, 1)))
    assert off_deg < 0.5


def test_walls_alone_are_enough():
    R = Rotation.from_euler("XY", [12, -7], degrees=True).as_matrix()
    up = estimate_up(surfaces(1, floor=0, walls=900, clutter=200) @ R.T)
    assert np.degrees(np.arccos(up @ R[:, 2])) < 1.0


def test_one_wall_and_nothing_else_stays_near_upright():
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


def test_no_floor_in_sight_is_none():
    rng = np.random.default_rng(0)
    points = rng.uniform([-8, -8, 0], [8, 8, 3], (500, 3))
    assert floor_height(points, np.tile([1.0, 0, 0], (500, 1))) is None


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


def test_a_floor_just_below_the_sensor_is_found():
    points = np.column_stack([np.tile([1.0, 2.0], 20), np.zeros(40), np.full(40, -0.07)])
    assert floor_height(points, np.tile([0.0, 0.0, 1.0], (40, 1))) == pytest.approx(0.07)
