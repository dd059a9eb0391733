"""Surfaces: normals of points, thinning at once and slab by slab."""

import numpy as np
import pytest

from firstfix.engine.registration import tile_rows as tile_rows_module
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.tile_rows import columns_of, tile_rows
from firstfix.engine.verification.point_tiles import PointTiles
from firstfix.transform import make_transform, rotation_z


def test_normals_of_a_plane_and_a_wall():
    rng = np.random.default_rng(1)
    floor = np.column_stack([rng.uniform(-3, 3, (800, 2)), np.zeros(800)])
    wall = np.column_stack([np.full(800, 20.0), rng.uniform(-3, 3, (800, 2))])
    surface = Surface.around(np.concatenate([floor, wall]))
    assert surface.points.dtype == surface.normals.dtype == np.float32
    assert np.allclose(np.abs(surface.normals[:800]), [0, 0, 1], atol=1e-3)
    assert np.allclose(np.abs(surface.normals[800:]), [1, 0, 0], atol=1e-3)


def test_normals_point_to_the_viewer_unless_the_surface_was_hardly_seen():
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform(-3, 3, (800, 2)), np.zeros(800)])
    for side in (1.0, -1.0):
        surface = Surface.around(floor, np.array([0.5, 0.5, 2 * side]) - floor)
        assert surface.oriented.all()
        assert np.allclose(surface.normals, [0, 0, side], atol=1e-3)
    for to_viewer in (None, np.tile([5.0, 0, 0.2], (800, 1)), np.zeros((800, 3))):
        assert not Surface.around(floor, to_viewer).oriented.any()


def test_faces_of_a_slab_keep_their_own_normals():
    """A ceiling that few rays met, 0.2 m below a floor that many did."""
    rng = np.random.default_rng(4)
    floor = np.column_stack([rng.uniform(-3, 3, (3600, 2)), np.zeros(3600)])
    ceiling = np.column_stack([rng.uniform(-3, 3, (1200, 2)), np.full(1200, -0.2)])
    to_viewer = np.concatenate([[0.3, 0.2, 1.5] - floor, [0.3, 0.2, -2] - ceiling])
    both = np.concatenate([floor, ceiling])
    facing = np.repeat([1, -1], [3600, 1200])
    inner = (np.abs(both[:, :2]) < 2.5).all(axis=1)  # at the border there is nothing to take a normal from
    mixed, apart = (Surface.around(both, to_viewer, two_faces) for two_faces in (False, True))
    assert ((facing * mixed.normals[:, 2])[inner & (facing < 0)] > 0.99).mean() < 0.2
    assert ((facing * apart.normals[:, 2])[inner & (facing < 0)] > 0.99).mean() > 0.9
    assert ((facing * apart.normals[:, 2])[inner & (facing > 0)] > 0.99).mean() > 0.95


def surface_of(points, normals, oriented=True):
    return Surface(np.float32(points), np.float32(normals), np.full(len(points), oriented))


def test_a_part_has_at_most_so_many_points_and_keeps_their_normals():
    points = np.arange(300, dtype=np.float32).reshape(100, 3)
    surface = surface_of(points, points + 1)
    for count in (1, 7, 33, 99, 100, 1000):
        part = surface.at_most(count, 0.5)
        assert 0 < len(part) <= count
        assert np.array_equal(part.normals, part.points + 1)
    assert len(surface.at_most(1000, 0.5)) == 100


def test_surfaces_are_moved_and_put_together():
    moved = surface_of([[1, 0, 0]], [[1, 0, 0]]).moved(make_transform(rotation_z(np.pi / 2), [0, 0, 3]))
    assert np.allclose(moved.points, [[0, 1, 3]], atol=1e-6)
    assert np.allclose(moved.normals, [[0, 1, 0]], atol=1e-6)
    one, other = surface_of([[0, 0, 0]], [[0, 0, 1]]), surface_of([[1, 0, 0]], [[0, 1, 0]], oriented=False)
    both = Surface.together([one, other])
    assert both.points[:, 0].tolist() == [0, 1]
    assert both.oriented.tolist() == [True, False]


def test_thinning_keeps_the_two_faces_of_a_wall_apart():
    faces = [[0.10, 0.1, 0.1], [0.12, 0.3, 0.3], [0.2, 0.1, 0.1], [0.22, 0.3, 0.1]]
    thinned = surface_of(faces, [[-1, 0, 0], [-1, 0, 0], [1, 0, 0], [1, 0, 0]]).thinned(1.0)
    assert np.allclose(sorted(thinned.points[:, 0]), [0.11, 0.21])
    assert sorted(thinned.normals[:, 0].tolist()) == [-1, 1]


def test_thinning_brings_normals_of_unknown_sign_together():
    thinned = surface_of([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1]], [[0, 0, 1], [0, 0, -1]], oriented=False).thinned(
        1.0
    )
    assert len(thinned) == 1
    assert np.allclose(np.abs(thinned.normals), [[0, 0, 1]])
    assert not thinned.oriented.any()


RNG = np.random.default_rng(3)
POINTS = RNG.uniform([-40, -20, 0], [35, 20, 4], (20_000, 3)).astype(np.float32)


@pytest.mark.parametrize(("side", "border"), [(7, 2), (16, 0), (3, 3), (400, 1)])
def test_a_tile_has_its_own_points_and_those_in_the_border_around_it(side: int, border: int):
    column = columns_of(POINTS, 0.5)
    seen = []
    for one in tile_rows(column, side, border):
        low = np.array(one.tile) * side
        inside = ((column >= low) & (column < low + side)).all(axis=1)
        around = ((column >= low - border) & (column < low + side + border)).all(axis=1)
        assert np.array_equal(one.rows, np.flatnonzero(around))
        assert np.array_equal(one.own, inside[one.rows])
        seen.append(one.tile)
    assert seen == sorted(set(seen))
    tiles = {tuple(tile) for tile in (column // side).tolist()}
    assert tiles <= set(seen)
    assert border or tiles == set(seen)


def test_no_points_have_no_tile():
    assert list(tile_rows(np.zeros((0, 2), np.int64), 5, 1)) == []


@pytest.fixture(params=[1.0, 9.0])
def small_tiles(request, monkeypatch):
    monkeypatch.setattr(tile_rows_module, "TILE_M", request.param)


def test_a_surface_is_thinned_the_same(small_tiles, monkeypatch):
    normals = RNG.normal(size=POINTS.shape).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surface = Surface(POINTS, normals, RNG.random(len(POINTS)) < 0.7)
    found = surface.thinned(0.8)
    monkeypatch.setattr(tile_rows_module, "TILE_M", 1000.0)
    whole = surface.thinned(0.8)
    mine, theirs = (np.lexsort((*one.normals.T, *one.points.T)) for one in (found, whole))
    assert np.array_equal(found.points[mine], whole.points[theirs])
    assert np.array_equal(found.normals[mine], whole.normals[theirs])
    assert np.array_equal(found.oriented[mine], whole.oriented[theirs])


def test_tiles_hold_the_same_points(small_tiles, monkeypatch):
    found = PointTiles.of(POINTS, 0.4)
    monkeypatch.setattr(tile_rows_module, "TILE_M", 1000.0)
    whole = PointTiles.of(POINTS, 0.4)
    assert np.array_equal(found.begin, whole.begin)
    assert np.array_equal(*(one.points[np.lexsort(one.points.T)] for one in (found, whole)))
