"""Hashes by place: they change where the map has changed, and nowhere else."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.config import ReconstructConfig
from firstfix.engine.config import OccupancyConfig
from firstfix.sensor import preset
from firstfix_builder.execution.stage_cache import StageResult
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.places.chance import stepped
from firstfix_builder.mesh.places.surface_cells import CELL_M, GROUP, SurfaceCells
from firstfix_builder.mesh.places.tiled_points import TILE_M, TiledPoints
from firstfix_builder.mesh.reconstruct import PoissonChunk
from firstfix_builder.mesh.tiled_mesh import TiledMesh
from firstfix_builder.templates.make import TemplatesChunk

RNG = np.random.default_rng(2)
CLOUD = RNG.uniform([-40, -20, 0], [60, 50, 3], (5000, 3))


def box(x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([x, y]), np.array([x + 5.0, y + 5.0])


def test_the_points_near_a_place_are_there_and_few_others(tmp_path: Path):
    TiledPoints.of(CLOUD).save(tmp_path)
    tiled = TiledPoints.load(tmp_path)
    assert sorted(map(tuple, tiled.points)) == sorted(map(tuple, CLOUD))
    for low, high in (box(-40, -20), box(-3, -3), box(55, 45)):
        near = {tuple(point) for point in tiled.near(low, high)}
        inside = (CLOUD[:, :2] >= low) & (CLOUD[:, :2] <= high)
        assert {tuple(point) for point in CLOUD[inside.all(axis=1)]} <= near
        assert all((np.array(p[:2]) > low - TILE_M).all() and (p[:2] < high + TILE_M).all() for p in near)
    nowhere = tiled.near(*box(900, 900))
    assert nowhere.shape == (0, 3)


def test_a_hash_of_points_tells_of_changes_near_by_and_of_no_others():
    low, high = box(0, 0)
    near = np.flatnonzero(((CLOUD[:, :2] > low) & (CLOUD[:, :2] < high)).all(axis=1))[0]
    far = np.flatnonzero(CLOUD[:, 0] > 40)[0]
    before = TiledPoints.of(CLOUD).digest_near(low, high)
    for number, changes in ((near, True), (far, False)):
        moved = CLOUD.copy()
        moved[number] += [0, 0, 0.01]
        assert (TiledPoints.of(moved).digest_near(low, high) != before) is changes
        without = np.delete(CLOUD, number, axis=0)
        assert (TiledPoints.of(without).digest_near(low, high) != before) is changes
    beyond = np.concatenate([CLOUD, [[-500.0, 3, 3], [500.0, 3, 3]]])
    assert TiledPoints.of(beyond).digest_near(low, high) == before, "the map's bounds do not count"


def triangles(*centres: tuple[float, float, float], size_m: float = 0.5) -> Mesh:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]) - [1 / 3, 1 / 3, 1 / 6]
    vertices = np.concatenate([centre + size_m * corners for centre in np.array(centres)])
    return Mesh(vertices, np.arange(len(vertices)).reshape(-1, 3))


def cells(mesh: Mesh) -> SurfaceCells:
    return SurfaceCells.of(mesh.vertices, mesh.triangles)


FIELD = [(x, y, z) for x in np.arange(1.0, 60, 2) for y in np.arange(1.0, 30, 2) for z in (0.0, 5.0)]


@pytest.mark.parametrize("reach_m", [0.0, 10.0])
def test_a_hash_of_the_surface_tells_of_changes_within_reach_and_of_no_others(reach_m: float):
    low, high = box(10, 10)
    before = cells(triangles(*FIELD)).digest_within(low, high, reach_m)
    for row in np.random.default_rng(6).choice(len(FIELD), len(FIELD) // 7, replace=False):
        x, y, _ = FIELD[row]
        mesh = triangles(*FIELD)
        mesh.vertices[3 * row : 3 * row + 3, 2] += 0.001
        changed = cells(mesh).digest_within(low, high, reach_m) != before
        gap = np.maximum(np.maximum(low - [x, y], [x, y] - high), 0)
        away_m = float(np.hypot(*gap))
        if away_m <= reach_m:
            assert changed
        if away_m > reach_m + 2**0.5 * CELL_M + 1:
            assert not changed


def test_cells_in_many_groups_give_the_hash_of_all_that_are_near():
    rng = np.random.default_rng(8)
    found = cells(triangles(*rng.uniform(-300, 300, (4000, 3)), size_m=3.0))
    assert len(found.cell) > 20 * GROUP
    for low_x, low_y, reach_m in [(0, 0, 0.0), (-250, 90, 30.0), (900, 900, 5.0), (-400, -400, 2000.0)]:
        low, high = box(low_x, low_y)
        gap = np.maximum(np.maximum(found.low[:, :2] - high, low - found.high[:, :2]), 0)
        near = np.hypot(*gap.T) <= reach_m
        wanted = sha256(found.cell[near].tobytes() + found.sha256[near].tobytes()).hexdigest()
        assert found.digest_within(low, high, reach_m) == wanted


def test_a_large_triangle_does_not_make_small_cells_large():
    small = [(x, 1.0, 1.0) for x in np.arange(0.0, 100, 1)]
    floor = triangles((50.0, 0.0, 0.0), size_m=90.0)
    whole = Mesh.joined([triangles(*small), floor])
    found = cells(whole)
    extent_m = (found.high - found.low).max(axis=1)
    assert (extent_m > 50).sum() == 1
    assert (extent_m < 2 * CELL_M).sum() == len(found.cell) - 1
    moved = Mesh(whole.vertices.copy(), whole.triangles)
    moved.vertices[-3:, 2] += 0.01
    for x in (30.0, 95.0):
        assert cells(moved).digest_within(*box(x, 0), 1.0) != found.digest_within(*box(x, 0), 1.0)


def test_a_part_that_looks_the_same_has_the_same_hash_whatever_the_order_of_the_rest(tmp_path: Path):
    one = TiledMesh.of(triangles(*FIELD))
    other = TiledMesh.of(triangles(*FIELD, (-300.0, 2.0, 0.0)))
    for name, tiled in (("one", one), ("other", other)):
        (tmp_path / name).mkdir()
        tiled.save(tmp_path / name)
    low, high = box(30, 5)
    found = [SurfaceCells.load(tmp_path / name).digest_within(low, high, 12.0) for name in ("one", "other")]
    assert found[0] == found[1]


def read_map(folder: Path, points: np.ndarray, poses: np.ndarray | None = None) -> StageResult:
    folder.mkdir()
    TiledPoints.of(points).save(folder)
    if poses is not None:
        np.save(folder / "trajectory.npy", poses)
    return StageResult("6" * 64, folder, "7" * 64)


def test_a_block_of_the_surface_reads_its_points_and_the_poses_near_it(tmp_path: Path):
    chunk = PoissonChunk((0.0, 0.0), (20.0, 20.0), 0.2, 0.15, ReconstructConfig())
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[5, 5, 1], [90, 5, 1], [300, 5, 1]]
    before = chunk.reads({"map": read_map(tmp_path / "before", CLOUD, poses)})
    elsewhere = CLOUD.copy()
    elsewhere[CLOUD[:, 0] > 35] += 0.1
    poses[2, 0, 3] += 5
    assert chunk.reads({"map": read_map(tmp_path / "elsewhere", elsewhere, poses)}) == before
    poses[1, 0, 3] += 5
    here = chunk.reads({"map": read_map(tmp_path / "poses", elsewhere, poses)})
    assert {name for name in before if before[name] != here[name]} == {"places"}
    at = np.flatnonzero(((CLOUD[:, :2] > 1) & (CLOUD[:, :2] < 19)).all(axis=1))[0]
    points = chunk.reads({"map": read_map(tmp_path / "points", np.delete(CLOUD, at, axis=0), poses)})
    assert {name for name in here if here[name] != points[name]} == {"points"}
    none = chunk.reads({"map": read_map(tmp_path / "none", CLOUD)})
    assert none["places"] == "none"


def test_templates_read_their_viewpoints_and_the_surface_that_their_descriptor_sees(tmp_path: Path):
    mesh, positions = triangles(*FIELD), RNG.uniform([16, 16, 1], [24, 24, 1], (9, 3))

    def reads(name: str, mesh: Mesh, positions: np.ndarray, max_range_m: float = 10.0) -> dict[str, str]:
        (tmp_path / name).mkdir()
        TiledMesh.of(mesh).save(tmp_path / name)
        np.save(tmp_path / name / "positions.npy", positions)
        np.save(tmp_path / name / "floor_z.npy", positions[:, 2] - 1)
        descriptor = OccupancyConfig(max_range_m=max_range_m)
        chunk = TemplatesChunk(0, 9, (2, 2), 8.0, 64.0, preset("vlp-16"), descriptor)
        stage = StageResult("6" * 64, tmp_path / name, "7" * 64)
        return dict(chunk.reads({"mesh": stage, "viewpoints": stage}))

    before = reads("before", mesh, positions)
    other = reads("moved", mesh, positions + [0, 0, 0.5])
    assert {name for name in before if before[name] != other[name]} == {"viewpoints"}
    far = Mesh(mesh.vertices.copy(), mesh.triangles)
    far.vertices[far.vertices[:, 0] > 45] += [0, 0, 0.2]
    assert reads("far", far, positions) == before
    seen = reads("seen", far, positions, 30.0)
    assert seen["mesh"] != reads("unseen", mesh, positions, 30.0)["mesh"]


def test_steps_are_fine_enough_and_hold_what_hardly_changes():
    assert stepped(1.0, 12) == 1.0
    for value in (0.03, 0.081, 0.5, 7.0, 40.0):
        assert stepped(stepped(value, 12), 12) == stepped(value, 12)
        assert abs(stepped(value, 12) / value - 1) < 0.03
        assert abs(stepped(value, 6) / value - 1) < 0.06
    near = [stepped(0.0834 * (1 + change), 12) for change in np.linspace(-0.002, 0.002, 9)]
    assert len(set(near)) == 1
