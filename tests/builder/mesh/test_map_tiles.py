"""Points and triangles tile by tile: nothing lost, and a part is what a reader of that place needs."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import BuildFailed
from firstfix_builder.mesh import tiled_mesh
from firstfix_builder.mesh.map_tiles import by_tiles
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.tiled_mesh import TILE_M, TiledMesh, write_tiled_mesh
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.sample_world.primitives import height_field


def test_points_stand_tile_by_tile():
    points = np.random.default_rng(3).uniform([-300, 50, 0], [100, 330, 5], (2000, 3))
    order, start = by_tiles(points, 100.0)
    assert sorted(order) == list(range(2000))
    seen = set()
    for first, last in pairwise(start):
        inside = points[order[first:last], :2]
        assert np.diff(order[first:last]).min() > 0  # as they stood
        tiles = {tuple(tile) for tile in np.floor(inside / 100.0).astype(int)}
        assert len(tiles) == 1
        seen |= tiles
    assert len(seen) == len(start) - 1 == 16


def test_what_lies_in_a_tile_does_not_depend_on_the_map_around_it():
    points = np.random.default_rng(3).uniform(0, 128, (200, 3))
    order, start = by_tiles(points, 128.0)
    assert order.tolist() == list(range(200))
    assert start.tolist() == [0, 200]
    order, start = by_tiles(np.concatenate([points - [900.5, 0, 0], points]), 128.0)
    assert order[start[-2] :].tolist() == list(range(200, 400))


@pytest.fixture(scope="module")
def field() -> Mesh:
    """Ground of 300 x 200 m with a pole every 20 m, its triangles in no order, a vertex of nobody."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(0, 300.0, 5), np.arange(0, 200.0, 5), indexing="ij")
    low = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    poles = low[::16] + rng.uniform(0, 3, (len(low[::16]), 3)) * [1, 1, 0]
    corners = np.concatenate(
        [
            np.stack([low, low + [5, 0, 0], low + [5, 5, 0]], axis=1),
            np.stack([low, low + [5, 5, 0], low + [0, 5, 0]], axis=1),
            np.stack([poles, poles + [0.5, 0.5, 0], poles + [0, 0, 4]], axis=1),
        ]
    )
    corners = corners[rng.permutation(len(corners))]
    vertices = np.concatenate([corners.reshape(-1, 3), [[9e3, 9e3, 0]]])
    return Mesh(vertices, np.arange(3 * len(corners)).reshape(-1, 3))


def test_a_tiled_mesh_has_the_same_triangles(field: Mesh, tmp_path: Path):
    TiledMesh.of(field).save(tmp_path)
    tiled = TiledMesh.load(tmp_path)

    def corners(mesh: Mesh) -> list[bytes]:
        return sorted(triangle.tobytes() for triangle in np.asarray(mesh.vertices[mesh.triangles]))

    assert corners(tiled.mesh) == corners(field) == corners(tiled.part(tuple(range(len(tiled.start) - 1))))
    assert len(tiled.mesh.vertices) == len(field.vertices) - 1
    assert len(tiled.start) - 1 == -(-305 // TILE_M) * -(-205 // TILE_M)


def test_rays_of_a_place_meet_in_its_part_what_they_meet_in_the_whole(field: Mesh, tmp_path: Path):
    TiledMesh.of(field).save(tmp_path)
    tiled = TiledMesh.load(tmp_path)
    place, reach_m = np.array([40.0, 60.0]), 50.0
    near = tiled.near(place, place, reach_m)
    part = tiled.part(near)
    assert 0.1 * len(field.triangles) < len(part.triangles) < 0.5 * len(field.triangles)
    turn = np.linspace(0, 2 * np.pi, 5000)
    rays = np.column_stack([np.cos(turn), np.sin(turn), np.full(5000, -0.05)])
    origins = np.tile([*place, 1.5], (5000, 1))
    ranges = [Simulator(mesh.vertices, mesh.triangles).cast(origins, rays) for mesh in (field, part)]
    seen = ranges[0] <= reach_m
    assert 0.5 < seen.mean() <= 1
    np.testing.assert_array_equal(ranges[1][seen], ranges[0][seen])


def test_far_from_everything_the_nearest_tile_stands_for_the_map(field: Mesh):
    tiled = TiledMesh.of(field)
    far = np.array([5e3, 5e3])
    assert tiled.near(far, far, 10.0) == (len(tiled.start) - 2,)


def test_a_mesh_in_parts_is_written_as_the_whole_one(
    field: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(tiled_mesh, "AT_ONCE", 700)
    wide = np.array([[0.0, 0, -5], [290, 3, -5], [100, 190, -5]])  # in cells of several tiles
    parts = [field.with_triangles(np.arange(len(field.triangles)) % 7 == k) for k in range(7)]
    parts[2:2] = [Mesh(wide, np.array([[0, 1, 2]])), Mesh.empty(), Mesh(wide - 1, np.array([[0, 2, 1]]))]
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
    TiledMesh.of(Mesh.joined(parts)).save(tmp_path / "whole")
    write_tiled_mesh(iter(parts), tmp_path / "parts")
    for file in ("vertices.npy", "triangles.npy", "tile_start.npy", "tile_box.npy", "surface_cells.npz"):
        assert (tmp_path / "whole" / file).read_bytes() == (tmp_path / "parts" / file).read_bytes(), file
    assert len(list((tmp_path / "parts").iterdir())) == len(list((tmp_path / "whole").iterdir()))


def test_no_triangle_at_all_is_refused(tmp_path: Path):
    with pytest.raises(BuildFailed, match="no surface"):
        write_tiled_mesh([Mesh.empty()], tmp_path)


def test_triangles_of_a_tile_share_their_vertices():
    x, y = np.meshgrid(np.arange(0, 97.0, 2), np.arange(0, 97.0, 2))
    tiled = TiledMesh.of(height_field(x[0], y[:, 0], 0 * x))
    assert len(tiled) == 3 * 3
    for number in range(len(tiled)):
        part = tiled.part([number])
        assert len(part.vertices) < 0.7 * len(part.triangles)
        assert (np.sort(np.unique(part.triangles)) == np.arange(len(part.vertices))).all()
