from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.config import ReconstructConfig
from firstfix.errors import BuildFailed
from firstfix.transform import make_transform
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.places.tiled_points import TiledPoints
from firstfix_builder.mesh.reconstruct import block_meshes, mesh_chunks
from firstfix_builder.simulation.simulate import Simulator
from tests.builder.box_scenes import box, floor, sampled

pytestmark = pytest.mark.slow

SURFACES = ("signed-distance", "poisson")


def reconstruct_mesh(
    points: NDArray[np.float64], trajectory: NDArray[np.float64] | None, config: ReconstructConfig
) -> Mesh:
    """All of the stage in this thread."""
    with tempfile.TemporaryDirectory() as folder:
        TiledPoints.of(points).save(Path(folder))
        if trajectory is not None:
            np.save(Path(folder) / "trajectory.npy", trajectory)
        chunks = mesh_chunks(points, trajectory, config)
        return Mesh.joined(block_meshes(chunk.run({"map": Path(folder)}) for chunk in chunks))


@pytest.fixture(scope="module")
def cloud() -> NDArray[np.float64]:
    """A courtyard: ground of 24 x 12 m with a block in it, scanned from outside, 1 cm noise."""
    block = box((10, 4, 0), (14, 8, 0.9))
    seen = Mesh(block.vertices, block.triangles[2:])  # nobody sees the underside
    ground = sampled(floor(0, 0, 24, 12), 80)
    ground = ground[(np.abs(ground[:, :2] - [12, 6]) > 2).any(axis=1)]
    points = np.concatenate([ground, sampled(seen, 80)])
    return points + np.random.default_rng(1).normal(0, 0.01, points.shape)


@pytest.fixture(scope="module")
def round_the_block(cloud: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cloud's 8 x 8 m with the block in their middle."""
    return cloud[(np.abs(cloud[:, :2] - [12, 6]) < 4).all(axis=1)]


@pytest.fixture(scope="module")
def trajectory() -> NDArray[np.float64]:
    x = np.arange(1, 23, 0.7)
    places = np.concatenate([np.column_stack([x, 0 * x + y, 0 * x + 1.8]) for y in (2, 10)])
    return np.stack([make_transform(np.eye(3), place) for place in places])


@pytest.fixture(scope="module", params=SURFACES)
def config(request: pytest.FixtureRequest) -> ReconstructConfig:
    """The config of each surface."""
    return ReconstructConfig(surface=request.param)


@pytest.fixture(scope="module")
def small_tiles(config: ReconstructConfig) -> ReconstructConfig:
    return config.model_copy(update={"tile_cells": 64})


@pytest.fixture(scope="module")
def tiled(
    cloud: NDArray[np.float64], trajectory: NDArray[np.float64], small_tiles: ReconstructConfig
) -> Mesh:
    return reconstruct_mesh(cloud, trajectory, small_tiles)


def down(mesh: Mesh, step_m: float = 0.05) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    x, y = np.meshgrid(np.arange(0.4, 23.6, step_m), np.arange(0.4, 11.6, step_m))
    origins = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 10.0)])
    rays = np.broadcast_to([0.0, 0.0, -1.0], origins.shape)
    return origins, 10 - Simulator(mesh.vertices, mesh.triangles).cast(origins, rays)


def test_the_surface_goes_through_the_points(cloud: NDArray[np.float64], tiled: Mesh):
    distance = Simulator(tiled.vertices, tiled.triangles).distance(cloud)
    assert np.median(distance) < 0.02
    assert np.percentile(distance, 95) < 0.08


def test_there_is_ground_and_a_roof_and_no_bubble(tiled: Mesh):
    origins, height = down(tiled)
    off_block = np.maximum(np.abs(origins[:, 0] - 12), np.abs(origins[:, 1] - 6)) - 2
    assert np.abs(height[off_block > 0.4]).max() < 0.1
    assert np.abs(height[off_block < -0.4] - 0.9).max() < 0.1
    assert tiled.vertices[:, 2].max() < 1.1
    assert tiled.vertices[:, 2].min() > -0.3


def test_tiles_meet_without_gap_or_double_surface(
    cloud: NDArray[np.float64], trajectory: NDArray[np.float64], tiled: Mesh, config: ReconstructConfig
):
    single = reconstruct_mesh(cloud, trajectory, config)
    origins, height = down(tiled)
    _, reference = down(single)
    assert np.isfinite(height).all()  # seams of 0.05 m would be seen by some of 100,000 rays
    near_block = np.maximum(np.abs(origins[:, 0] - 12), np.abs(origins[:, 1] - 6)) < 2.4
    assert np.abs(height - reference)[~near_block].max() < 0.03
    below = Simulator(tiled.vertices, tiled.triangles)
    ground = origins[~near_block] * [1, 1, 0] + [0, 0, -0.1]
    assert np.isinf(below.drops(ground)).all()  # one layer of ground, at the seams too

    def area(mesh: Mesh) -> float:
        a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    assert area(tiled) == pytest.approx(area(single), rel=0.01)


def test_without_a_trajectory_the_ground_still_faces_up(
    round_the_block: NDArray[np.float64], small_tiles: ReconstructConfig
):
    mesh = reconstruct_mesh(round_the_block, None, small_tiles)
    distance = Simulator(mesh.vertices, mesh.triangles).distance(round_the_block)
    assert np.percentile(distance, 95) < 0.08
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    up = np.cross(b - a, c - a)[:, 2]
    flat = np.abs(a[:, 2]) < 0.1
    assert up[flat][up[flat] > 0].sum() > 0.98 * np.abs(up[flat]).sum()


def test_no_surface_where_there_is_no_data(
    cloud: NDArray[np.float64], trajectory: NDArray[np.float64], config: ReconstructConfig
):
    west = cloud[cloud[:, 0] < 10]
    hole = (np.abs(west[:, :2] - 6) < 2).all(axis=1)
    mesh = reconstruct_mesh(west[~hole], trajectory, config)
    origin = np.array([[6.0, 6.0, 5.0]])
    assert np.isinf(Simulator(mesh.vertices, mesh.triangles).drops(origin)).all()


def test_far_coordinates_lose_nothing(
    round_the_block: NDArray[np.float64], trajectory: NDArray[np.float64], small_tiles: ReconstructConfig
):
    shift = np.array([4096.0, -8192.0, 64.0])
    moved = trajectory.copy()
    moved[:, :3, 3] += shift
    mesh = reconstruct_mesh(round_the_block + shift, moved, small_tiles)
    distance = Simulator(mesh.vertices - shift, mesh.triangles).distance(round_the_block)
    assert np.percentile(distance, 95) < 0.08


def test_too_few_points_are_refused(config: ReconstructConfig):
    with pytest.raises(BuildFailed, match="no surface"):
        reconstruct_mesh(np.random.default_rng(0).random((20, 3)), None, config)


@pytest.mark.parametrize("shape", ["scattered", "line", "vertical line", "one place"])
def test_points_that_are_no_surface_do_not_crash_the_solver(shape: str, config: ReconstructConfig):
    points = np.random.default_rng(0).random((300, 3)) * 50
    points *= {"scattered": 1, "line": [1, 0, 0], "vertical line": [0, 0, 1], "one place": 0}[shape]
    try:
        mesh = reconstruct_mesh(points, None, config)
    except BuildFailed:
        return
    assert np.isfinite(mesh.vertices).all()
