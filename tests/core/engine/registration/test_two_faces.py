"""Slabs and walls so thin that both of their faces lie in one cell of the coarse grid."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.other_faces import other_faces
from firstfix.engine.registration.surface import Surface
from firstfix.transform import make_transform, pose_error, rotation_z

CONFIG = RegistrationConfig()
STEP_M = 0.1
THICK_M = 0.2


def patch(corner: list[float], along: list[float], across: list[float]) -> NDArray[np.float64]:
    """Points of a rectangle, STEP_M apart."""
    sides = [np.linalg.norm(side) for side in (along, across)]
    a, b = (np.arange(STEP_M / 2, side, STEP_M) / side for side in sides)
    grid = np.stack(np.meshgrid(a, b), axis=-1).reshape(-1, 2)
    return np.array(corner) + grid @ np.array([along, across])


def room(low: list[float], high: list[float]) -> Surface:
    """The inner faces of a box, seen from its middle."""
    low, high = np.array(low, float), np.array(high, float)
    x, y, z = np.diag(high - low)
    points = np.concatenate(
        [
            *(patch(corner, x, y) for corner in (low, low + z)),
            *(patch(corner, y, z) for corner in (low, low + x)),
            *(patch(corner, x, z) for corner in (low, low + y)),
        ]
    )
    return Surface.around(points, (low + high) / 2 - points)


def scan_of(seen: Surface, T_map_sensor: NDArray[np.float64]) -> Surface:
    """A sixth of the points, with noise."""
    rows = rows_by_chance(len(seen), len(seen) // 6)
    points = (seen.points[rows] - T_map_sensor[:3, 3]) @ T_map_sensor[:3, :3]
    points += np.random.default_rng(3).normal(0, 0.01, points.shape)
    return Surface.around(points, -points)


def worst_m(
    surface: MapSurface, scan: Surface, T_true: NDArray[np.float64], off_m: NDArray[np.float64]
) -> float:
    """Largest error of the poses that starts off by (k, 3) end at."""
    starts = np.array([make_transform(np.eye(3), off) @ T_true for off in off_m])
    near = surface.align(scan.at_most(400, 0.25), surface.align_coarse(scan, starts)[0])
    ends = surface.align_fine(scan, near.T_level_sensor).T_level_sensor
    return max(pose_error(T_true, T)[0] for T in ends)


def along(axis: int) -> NDArray[np.float64]:
    """Offsets (k, 3) of some decimetres, both ways along an axis and a little along the others."""
    off_m = np.random.default_rng(7).uniform(-0.15, 0.15, (8, 3))
    off_m[:, axis] = [-0.4, -0.3, -0.25, -0.2, 0.2, 0.25, 0.3, 0.4]
    return off_m


@pytest.mark.parametrize("floor_m", np.arange(0, 0.6, 0.1))
def test_a_scan_on_a_slab_ends_on_its_upper_face(floor_m: float):
    """Wherever the slab lies in the grid's cells: the ceiling below must not hide the floor."""
    below = room([0, 0, floor_m - THICK_M - 2.6], [8, 6, floor_m - THICK_M])
    here = room([0, 0, floor_m], [8, 6, floor_m + 2.6])
    surface = MapSurface.of(Surface.together([below, here]), CONFIG)
    seen = here.at(here.points[:, 2] < floor_m + 2.3)  # as of a sensor that does not see its own ceiling
    T_true = make_transform(rotation_z(0.5), [3.0, 2.5, floor_m + 1])
    off_m = worst_m(surface, scan_of(seen, T_true), T_true, along(2))
    assert off_m < 0.02


@pytest.mark.parametrize("wall_m", np.arange(5, 5.6, 0.1))
def test_a_scan_beside_a_thin_wall_ends_on_its_side(wall_m: float):
    """The other room's face of the wall must not hide this one's."""
    here = room([0, 0, 0], [wall_m, 6, 2.6])
    beside = room([wall_m + THICK_M, 0, 0], [wall_m + 6, 6, 2.6])
    surface = MapSurface.of(Surface.together([here, beside]), CONFIG)
    seen = here.at(here.points[:, 0] > 0.5)  # of the walls across x only the thin one
    T_true = make_transform(rotation_z(0.5), [3.0, 2.5, 1])
    off_m = worst_m(surface, scan_of(seen, T_true), T_true, along(0))
    assert off_m < 0.02


def test_a_raised_or_lowered_floor_is_screened_back_to_its_height():
    """A decimetre or two above or below, its points still find the floor on the coarse grid."""
    ceiling = patch([0, 0, -THICK_M], [8, 0, 0], [0, 6, 0])
    floor = patch([0, 0, 0], [8, 0, 0], [0, 6, 0])
    eye = np.array([4, 3, 1])
    points = np.concatenate([floor, ceiling])
    to_viewer = np.concatenate([eye - floor, [4, 3, -1.5] - ceiling])
    surface = MapSurface.of(Surface.around(points, to_viewer), CONFIG)
    scan = Surface.around(floor - eye, eye - floor)
    for off_m in np.linspace(-0.25, 0.25, 11):
        T = make_transform(np.eye(3), eye + [0, 0, off_m])
        found = surface.screen(scan, T[None])
        assert found[0][0, 2, 3] == pytest.approx(1, abs=0.02)


def test_the_other_face_is_the_nearest_that_faces_the_other_way():
    ceiling = patch([0, 0, -THICK_M], [2, 0, 0], [0, 2, 0])
    floor = patch([0, 0, 0], [2, 0, 0], [0, 2, 0])
    far = patch([0, 0, 2], [2, 0, 0], [0, 2, 0])
    count = len(floor)
    points = np.concatenate([floor, ceiling, far]).astype(np.float32)
    normals = np.repeat(np.float32([[0, 0, 1], [0, 0, -1], [0, 0, -1]]), count, axis=0)
    oriented = np.ones(len(points), np.bool_)
    found = other_faces(Surface(points, normals, oriented), 0.5)
    assert np.array_equal(found[:count], np.arange(count) + count)
    assert np.array_equal(found[count : 2 * count], np.arange(count))
    assert (found[2 * count :] == -1).all()  # nothing within reach
    oriented[count : 2 * count] = False
    assert (other_faces(Surface(points, normals, oriented), 0.5) == -1).all()  # nobody knows which face it is
