from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial import cKDTree

from firstfix.engine.made_of import Arrays
from firstfix.engine.registration import surface_grid_build, tile_rows
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid

CELL_M = 0.2


def surface_of(points: np.ndarray) -> Surface:
    points = points.astype(np.float32)
    return Surface(points, np.tile(np.float32([0, 0, 1]), (len(points), 1)), np.zeros(len(points), np.bool_))


class Known:
    """Grid that takes positions in the surface's own coordinates."""

    def __init__(self, surface: Surface) -> None:
        self.surface, self.grid = surface, SurfaceGrid.of(surface, CELL_M)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        return self.grid.nearest(np.float32(points) - self.grid.corner)


@pytest.fixture(
    params=[surface_grid_build.MAX_GROUPS, 4], ids=["small groups", "groups grown to fit the table"]
)
def grid(request, monkeypatch):
    monkeypatch.setattr(surface_grid_build, "MAX_GROUPS", request.param)
    rng = np.random.default_rng(3)
    return Known(surface_of(rng.uniform([-7, 2, -1], [5, 9, 2], (3000, 3))))


def test_a_point_is_found_near_every_point(grid):
    points = grid.surface.points
    found = grid.nearest(points)
    assert (found >= 0).all()
    assert np.linalg.norm(points[found] - points, axis=1).max() <= np.sqrt(3) * CELL_M


def test_at_the_centre_of_a_cell_the_nearest_of_all_is_found(grid):
    rng = np.random.default_rng(4)
    cells = np.unique(np.floor(rng.uniform([-7, 2, -1], [5, 9, 2], (2000, 3)) / CELL_M), axis=0)
    centres = ((cells + 0.5) * CELL_M).astype(np.float32)
    distance, row = cKDTree(grid.surface.points).query(centres)
    surely_known = distance < CELL_M  # within a cell's width, so in the cell or one beside it
    assert surely_known.sum() > 300
    assert np.array_equal(grid.nearest(centres[surely_known]), row[surely_known])


def test_two_cells_away_nothing_is_near(grid):
    rng = np.random.default_rng(5)
    anywhere = rng.uniform(-12, 12, (5000, 3)).astype(np.float32)
    distance, _ = cKDTree(grid.surface.points).query(anywhere)
    far = distance > 2 * np.sqrt(3) * CELL_M
    assert far.sum() > 1000
    assert (grid.nearest(anywhere[far]) == -1).all()


def test_a_kilometre_outside_nothing_is_near(grid):
    outside = np.float32([[1000, 0, 0], [-1000, 5, 0], [0, 5, 1e6], [0, -1e6, 0]])
    assert (grid.nearest(outside) == -1).all()


def test_a_grid_of_one_point_finds_it():
    grid = Known(surface_of(np.array([[3.0, -2.0, 1.0]])))
    asked = np.float32([[3.0, -2.0, 1.0], [3.1, -2.1, 1.1], [3.9, -2.0, 1.0]])
    assert grid.nearest(asked).tolist() == [0, 0, -1]


def test_a_plane_gives_the_distance_along_its_normal(grid):
    rng = np.random.default_rng(6)
    asked = grid.surface.points + rng.uniform(-0.05, 0.05, grid.surface.points.shape).astype(np.float32)
    row = grid.nearest(asked)
    plane = grid.grid.planes[row]
    off_m = plane[:, 3] - np.einsum("ij,ij->i", asked - grid.grid.corner, plane[:, :3])
    assert np.allclose(off_m, grid.surface.points[row, 2] - asked[:, 2], atol=1e-5)  # normals are upright


def test_a_loaded_grid_finds_the_same(grid, tmp_path):
    grid.grid.save(tmp_path / "grid")
    again = SurfaceGrid.load(tmp_path / "grid")
    points = np.random.default_rng(8).uniform(0, 13, (2000, 3)).astype(np.float32)
    assert np.array_equal(again.nearest(points), grid.grid.nearest(points))
    assert np.array_equal(again.planes, grid.grid.planes)


def facing(points: np.ndarray, seed: int) -> Surface:
    """Surface of points whose normals face six ways, most of them known."""
    rng = np.random.default_rng(seed)
    normals = np.float32([[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    return Surface(
        points.astype(np.float32), normals[rng.integers(0, 6, len(points))], rng.random(len(points)) < 0.8
    )


@pytest.mark.parametrize("tile_m", [1.0, 7.0, 20.0])
def test_tiles_make_no_difference(tile_m: float, monkeypatch: pytest.MonkeyPatch):
    surface = facing(np.random.default_rng(10).uniform([-30, 2, -1], [25, 9, 2], (9000, 3)), 12)
    monkeypatch.setattr(tile_rows, "TILE_M", 1000.0)
    whole = SurfaceGrid.of(surface, CELL_M)
    assert np.mean(whole.other_face >= 0) > 0.1
    monkeypatch.setattr(tile_rows, "TILE_M", tile_m)
    again = SurfaceGrid.of(surface, CELL_M)
    for field in fields(SurfaceGrid):
        assert np.array_equal(getattr(again, field.name), getattr(whole, field.name)), field.name


class Remembered:
    """Makes each piece once (``MadeOf``), and counts those that it makes."""

    def __init__(self) -> None:
        self.made = 0
        self._known: dict[tuple[bytes, ...], Arrays] = {}

    def __call__(self, work: str, content: Sequence[np.ndarray], make: Callable[[], Arrays]) -> Arrays:
        key = (work.encode(), *(one.tobytes() for one in content))
        if key not in self._known:
            self.made += 1
            self._known[key] = {name: array.copy() for name, array in make().items()}
        return dict(self._known[key])


def test_of_a_change_only_the_tiles_around_it_are_made_again():
    points = np.random.default_rng(13).uniform([-150, 2, -1], [150, 9, 2], (20_000, 3))
    moved = points.copy()
    moved[np.abs(points[:, 0] - 20) < 2, 2] += 0.1
    remembered = Remembered()
    SurfaceGrid.of(facing(points, 1), CELL_M, remembered)
    tiles, remembered.made = remembered.made, 0
    assert tiles >= 8
    for changed, least, most in ((points, 0, 0), (moved, 1, 2)):
        found, whole = (SurfaceGrid.of(facing(changed, 1), CELL_M, *how) for how in ([remembered], []))
        assert least <= remembered.made <= most
        for field in fields(SurfaceGrid):
            assert np.array_equal(getattr(found, field.name), getattr(whole, field.name)), field.name


def test_a_kilometre_takes_little_more_than_its_surface():
    """Two patches three kilometres apart: a table of every 0.8 m block between them has 10^9 entries."""
    rng = np.random.default_rng(11)
    patch = rng.uniform([0, 0, 0], [4, 4, 1], (2000, 3))
    grid = Known(surface_of(np.concatenate([patch, patch + [3000, 2500, 60]])))
    assert grid.grid.group.nbytes + grid.grid.block.nbytes < 70e6
    found = grid.nearest(grid.surface.points)
    assert np.linalg.norm(grid.surface.points[found] - grid.surface.points, axis=1).max() <= 0.4
