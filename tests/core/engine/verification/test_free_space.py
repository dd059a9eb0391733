"""Free space in a room of known walls: scans that see through them, and objects in the way."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.engine.config import RegistrationConfig
from firstfix.engine.index import FreeSpaceShares, MapView
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.scan.reduction import RangeView
from firstfix.transform import make_transform, rotation_z
from tests.reference import free_space as reference
from tests.reference.recorded_places import MAPS, recorded_place


def box_surface(size: np.ndarray, spacing_m: float = 0.08) -> np.ndarray:
    """(n, 3) points on the walls, floor and ceiling of a box around the origin."""
    faces = []
    for axis in range(3):
        across = [a for a in range(3) if a != axis]
        u, v = (np.arange(-size[a] / 2, size[a] / 2 + 1e-9, spacing_m) for a in across)
        grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        for side in (-0.5, 0.5):
            face = np.empty((len(grid), 3))
            face[:, across], face[:, axis] = grid, side * size[axis]
            faces.append(face)
    return np.concatenate(faces)


ROOM = np.array([10.0, 8.0, 3.0])
WALLS = box_surface(ROOM)


def seen_through(
    points: np.ndarray, scan: RangeView, T: np.ndarray, reach_m: float = 20.0
) -> FreeSpaceShares:
    surface = MapSurface.of(Surface.around(points), RegistrationConfig())
    return MapView.of(points, reach_m).seen_through(surface, scan, T)


def scan_of(points: np.ndarray, T_map_sensor: np.ndarray) -> RangeView:
    return RangeView.of(((points - T_map_sensor[:3, 3]) @ T_map_sensor[:3, :3]).astype(np.float32))


@pytest.mark.parametrize("yaw_deg", [0, 35, -120])
def test_nothing_is_seen_through_at_the_true_pose(yaw_deg):
    T = make_transform(rotation_z(np.radians(yaw_deg)), [1.0, -0.7, 0.2])
    found = seen_through(WALLS, scan_of(WALLS, T), T)
    assert found.free_space_violation + found.removed_surface < 0.005


def test_a_removed_wall_is_told_from_a_contradiction():
    wall = box_surface(np.array([0.1, 8.0, 3.0])) + [2.0, 0, 0]
    T = make_transform(np.eye(3), [0.0, 0, 0])
    found = seen_through(np.concatenate([WALLS, wall]), scan_of(WALLS, T), T)
    assert (
        0.08 < found.removed_surface < 0.5
    )  # it stood before the far wall and before what lies on the way there
    assert found.free_space_violation < 0.001


def test_a_scan_that_ends_behind_the_map_contradicts_it():
    T = make_transform(np.eye(3), [0.0, 0, 0])
    hall = box_surface(np.array([30.0, 24.0, 9.0]))
    found = seen_through(WALLS, scan_of(hall, T), T)
    assert found.free_space_violation > 0.9
    assert found.removed_surface < 0.01


def test_a_return_outside_of_the_grid_is_near_nothing():
    """The grid ends a cell beyond the map: what lies further out must not be taken for the border's cell."""
    T = make_transform(np.eye(3), [0.0, 0, 0])
    far_out = seen_through(WALLS, scan_of(box_surface(np.array([500.0, 8.0, 3.0]), 1.0), T), T)
    assert far_out.removed_surface < 0.1 < far_out.free_space_violation


def test_an_unmapped_thing_before_a_wall_contradicts_nothing():
    """A passer-by, a new shelf: the map lacks it, and that contradicts no pose."""
    shelf = box_surface(np.array([0.1, 6.0, 3.0])) + [2.0, 0, 0]
    T = make_transform(np.eye(3), [0.0, 0, 0])
    seen = WALLS[(WALLS[:, 0] < 2) | (np.abs(WALLS[:, 1]) > 3)]
    scan = scan_of(np.concatenate([seen, shelf]), T)
    found = seen_through(WALLS, scan, T)
    assert found.free_space_violation + found.removed_surface < 0.01


def test_at_a_pose_a_metre_off_walls_are_seen_through():
    T = make_transform(np.eye(3), [0.0, 0, 0])
    shifted = make_transform(np.eye(3), [1.2, 0, 0])
    found = seen_through(WALLS, scan_of(WALLS, T), shifted)
    assert found.free_space_violation > 0.05


def test_far_from_the_map_everything_contradicts():
    nowhere = make_transform(np.eye(3), [500.0, 0, 0])
    nothing = RangeView.of(np.empty((0, 3), np.float32))
    assert seen_through(WALLS, scan_of(WALLS, np.eye(4)), nowhere) == FreeSpaceShares(1.0, 0.0)
    assert seen_through(WALLS, nothing, np.eye(4)) == FreeSpaceShares(1.0, 0.0)


def test_tiles_give_the_shares_of_all_points():
    rng = np.random.default_rng(2)
    points = rng.uniform([-60, -40, 0], [60, 40, 5], (60_000, 3))
    T = make_transform(np.eye(3), [17.0, -9.0, 1.0])
    scan = rng.normal(0, 3, (5000, 3)).astype(np.float32)
    within = RangeView.of(scan[np.linalg.norm(scan, axis=1) < 11])
    near, far = (seen_through(points, within, T, reach_m) for reach_m in (12.0, 500.0))
    assert near.free_space_violation == pytest.approx(far.free_space_violation, abs=0.02)
    assert near.removed_surface == pytest.approx(far.removed_surface, abs=0.02)


@pytest.mark.parametrize("name", list(MAPS))
def test_the_shares_are_those_of_numpy(name):
    place, rng = recorded_place(name), np.random.default_rng(3)
    for query, T in place.scans:
        for metres, radians in ((0, 0), (0.3, 0.02), (2.0, 0.3), (5.0, 2.0)):
            turn = Rotation.from_rotvec(rng.normal(0, radians + 1e-9, 3)).as_matrix()
            at = T @ make_transform(turn, rng.normal(0, metres + 1e-9, 3))
            view = query.scans[0].view
            wanted = reference.seen_through(place.view, place.surface.coarse, view, at)
            found = place.view.seen_through(place.surface, view, at)
            # a return on the border of two cells may lie in either
            assert found.free_space_violation == pytest.approx(wanted.free_space_violation, abs=1e-3)
            assert found.removed_surface == pytest.approx(wanted.removed_surface, abs=1e-3)
            assert 0 < found.free_space_violation + found.removed_surface < 1


@pytest.mark.parametrize("band_deg", [(-90, -60), (-15, 15), (-1, 1), (-90, 90), (70, 90), (88.5, 90)])
def test_a_scan_of_few_elevations_is_checked_there(band_deg):
    """Points at other elevations are not drawn, and none that counts is left out."""
    rng = np.random.default_rng(4)
    points = rng.uniform([-20, -20, -20], [20, 20, 20], (60_000, 3))
    view, surface = MapView.of(points, 20.0), MapSurface.of(Surface.around(points), RegistrationConfig())
    away = rng.normal(0, 3, (40_000, 3)).astype(np.float32)
    elevation_deg = np.degrees(np.arctan2(away[:, 2], np.linalg.norm(away[:, :2], axis=1)))
    scan = RangeView.of(away[(elevation_deg > band_deg[0]) & (elevation_deg < band_deg[1])])
    for _ in range(5):
        T = make_transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-5, 5, 3))
        wanted, found = (
            reference.seen_through(view, surface.coarse, scan, T),
            view.seen_through(surface, scan, T),
        )
        assert found.free_space_violation == pytest.approx(wanted.free_space_violation, abs=1e-3)
        assert found.free_space_violation + found.removed_surface == pytest.approx(
            wanted.free_space_violation + wanted.removed_surface, abs=1e-9
        )
