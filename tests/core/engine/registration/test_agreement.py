"""Agreement of a placed scan with the map: the kernel beside NumPy, and rooms where the answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix import native
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.align import Agreement, MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.transform import make_transform
from tests.reference import registration as reference
from tests.reference.recorded_places import MAPS, recorded_place

INLIER_M = 0.15
CONFIG = RegistrationConfig(inlier_distance_m=INLIER_M)
TWIST = np.array([1.0, 0, 0, 0, 0, 1.0])


def wall(at_m: tuple[float, float], along: tuple[float, float], length_m: float = 4.0) -> Surface:
    """An upright plane, 2.5 m high, that faces the origin."""
    along_m, z = np.meshgrid(np.arange(0, length_m, 0.1), np.arange(0, 2.5, 0.1))
    points = np.column_stack(
        [*(at_m[axis] + along[axis] * along_m.ravel() for axis in range(2)), z.ravel()]
    ).astype(np.float32)
    normal = np.array([along[1], -along[0], 0.0])
    normal *= -np.sign(normal @ points[0]) or 1
    return Surface(points, np.tile(normal.astype(np.float32), (len(points), 1)), np.ones(len(points), bool))


NORTH, SOUTH = wall((-2, 3), (1, 0)), wall((-2, -3), (1, 0))
EAST, WEST = wall((4, -2), (0, 1)), wall((-4, -2), (0, 1))
ROOM = Surface.together([NORTH, SOUTH, EAST, WEST])


def agreement(of_map: Surface, scan: Surface, T: np.ndarray | None = None) -> Agreement:
    return MapSurface.of(of_map, CONFIG).agreements(scan, (np.eye(4) if T is None else T)[None])[0]


@pytest.mark.parametrize("name", list(MAPS))
def test_the_kernel_agrees_with_numpy(name: str):
    place = recorded_place(name)
    for number, (query, T) in enumerate(place.scans):
        reach_m = np.array([[0], [0.05], [0.2], [0.5], [1], [30]])
        off_m = np.random.default_rng(number).uniform(-1, 1, (6, 3)) * reach_m
        poses = np.array([T @ make_transform(np.eye(3), at) for at in off_m])
        for scan in (query.sparse, query.dense):
            wanted = reference.agreement(place.surface.fine, place.surface.coarse, scan, poses, INLIER_M)
            found = native.agreement(
                place.surface.fine.tables,
                place.surface.coarse.tables,
                scan.points,
                scan.normals,
                scan.oriented,
                poses,
                INLIER_M,
            )
            # a point on a border may be counted on its other side
            np.testing.assert_allclose(found[0], wanted[0], atol=2 / len(scan))
            np.testing.assert_allclose(found[1], wanted[1], atol=0.01)


def test_a_scan_of_the_map_lies_beside_nothing():
    assert agreement(ROOM, ROOM).beside_surface == 0


def test_points_near_a_wall_are_beside_it_and_far_ones_are_not():
    shelf = wall((-2, 2.6), (1, 0))
    assert agreement(ROOM, Surface.together([ROOM, shelf])).beside_surface == pytest.approx(0.2)
    unmapped = wall((-2, 30), (1, 0))
    assert agreement(ROOM, Surface.together([ROOM, unmapped])).beside_surface == 0


def test_agreement_of_more_surfaces_lowers_the_share_on_one_plane():
    corridor = agreement(ROOM, Surface.together([NORTH, SOUTH]))
    room = agreement(ROOM, ROOM)
    assert agreement(ROOM, NORTH).same_plane == 1
    assert corridor.same_plane == pytest.approx(1 / 2, abs=0.01)
    assert room.same_plane == pytest.approx(1 / 4, abs=0.01)
    # surfaces that the map lacks do not count
    assert agreement(NORTH, ROOM).same_plane == 1


def test_floors_and_ceilings_do_not_count_as_planes():
    x, y = np.meshgrid(np.arange(-4, 4, 0.1), np.arange(-3, 3, 0.1))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float32)
    floor = Surface(points, np.tile(np.float32([0, 0, 1]), (len(points), 1)), np.ones(len(points), bool))
    both = Surface.together([ROOM, floor])
    assert agreement(both, both).same_plane == pytest.approx(1 / 4, abs=0.01)
    assert agreement(floor, floor) == Agreement(0.0, 1.0)


def test_without_points_nothing_is_claimed():
    assert agreement(ROOM, ROOM.at(slice(0, 0))) == Agreement(0.0, 1.0)
    assert MapSurface.of(ROOM, CONFIG).agreements(ROOM, np.empty((0, 4, 4))) == []


def test_poses_that_are_no_numbers_are_answered_within_limits():
    rng = np.random.default_rng(3)
    for _ in range(50):
        T = np.eye(4)
        T.ravel()[rng.integers(16, size=4)] = rng.choice([np.nan, np.inf, -np.inf, 1e300], 4)
        found = agreement(ROOM, ROOM, T)
        assert 0 <= found.beside_surface <= 1
        assert 0 <= found.same_plane <= 1


def test_a_scan_in_motion_is_deskewed_by_its_twist():
    times = np.linspace(-0.05, 0.05, len(ROOM)).astype(np.float32)
    moving = Surface(ROOM.points, ROOM.normals, ROOM.oriented, times)
    assert moving.deskewed(None) is moving
    assert ROOM.deskewed(TWIST) is ROOM
    points = moving.deskewed(TWIST).points
    np.testing.assert_array_equal(points, native.deskew(ROOM.points, times, TWIST))
    assert np.abs(points - ROOM.points).max() > 0.1
