"""Kernels of the registration beside NumPy on recorded places, and on tables and poses that are damaged."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix import native
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.transform import make_transform, pose_error, transform_points
from tests.core.engine.fixtures import slab
from tests.reference import registration as reference
from tests.reference.recorded_places import RecordedPlace

FINE = {"iterations": 12, "reach_m": 0.5, "half_angle": 0.06}
STEPS = {
    "coarse": {"iterations": 10, "reach_m": 0.9, "half_angle": 0.2},
    "align": {"iterations": 4, "reach_m": 0.5, "half_angle": 0.06},
    "fine": FINE,
}
INLIER_M = 0.15


def align(grid: SurfaceGrid, scan: Surface, starts: np.ndarray, **parameters: float):
    """The kernel's poses, inlier ratios, alignment scores, information, and which poses rest."""
    return native.align(
        grid.tables,
        scan.points,
        scan.normals,
        scan.oriented,
        starts,
        inlier_distance_m=INLIER_M,
        **parameters,
    )


def starts_around(T: np.ndarray, count: int, seed: int, metres: float = 0.4) -> np.ndarray:
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.normal(0, 0.05, (count, 3))).as_matrix()
    return np.array([T @ make_transform(turn, rng.uniform(-metres, metres, 3)) for turn in turns])


@pytest.mark.parametrize("step", list(STEPS))
def test_poses_are_those_of_numpy(place: RecordedPlace, step: str):
    grid = place.surface.coarse if step == "coarse" else place.surface.fine
    errors = []
    for number, (query, T) in enumerate(place.scans):
        scan = query.dense if step == "fine" else query.sparse
        starts = starts_around(T, 12, number)
        wanted, information = reference.align(grid, scan, starts, **STEPS[step])
        found = align(grid, scan, starts, **STEPS[step])
        errors += [pose_error(*pair) for pair in zip(wanted, found[0], strict=True)]
        np.testing.assert_allclose(found[3], information, rtol=0.05, atol=0.05 * np.abs(information).max())
        ratio, score = reference.quality(grid, scan, found[0], INLIER_M)
        assert np.abs(found[1] - ratio).max() < 1e-5
        assert np.abs(found[2] - score).max() < 1e-5
    distance_m, angle_deg = np.array(errors).T
    assert np.median(distance_m) < 1e-4
    assert distance_m.max() < 0.01
    assert angle_deg.max() < 0.05


def test_one_step_is_that_of_numpy(place: RecordedPlace):
    """After one step nothing has grown apart yet: the same to single precision."""
    once = {**FINE, "iterations": 1}
    for number, (query, T) in enumerate(place.scans):
        starts = starts_around(T, 30, number)
        wanted, information = reference.align(place.surface.fine, query.sparse, starts, **once)
        found = align(place.surface.fine, query.sparse, starts, **once)
        assert np.abs(found[0] - wanted).max() < 1e-5
        assert np.abs(found[3] - information).max() < 1e-5 * np.abs(information).max()


def test_a_pose_is_aligned_to_the_same_bits_alone_and_among_others(place: RecordedPlace):
    query, T = place.scans[0]
    starts = starts_around(T, 5, 1)
    together = align(place.surface.fine, query.sparse, starts, **FINE)
    for number in range(5):
        alone = align(place.surface.fine, query.sparse, starts[number : number + 1], **FINE)
        for one, all_of_them in zip(alone, together, strict=True):
            assert np.array_equal(one[0], all_of_them[number])


def test_without_iterations_the_start_is_rated(place: RecordedPlace):
    query, T = place.scans[0]
    starts = starts_around(T, 5, 2)
    found = align(place.surface.fine, query.dense, starts, **{**FINE, "iterations": 0})
    assert np.array_equal(found[0], starts)
    ratio, score = reference.quality(place.surface.fine, query.dense, starts, INLIER_M)
    np.testing.assert_allclose(found[1], ratio, atol=1e-6)
    np.testing.assert_allclose(found[2], score, atol=1e-6)


def test_the_grid_finds_the_rows_that_numpy_finds(place: RecordedPlace):
    grid, (query, T) = place.surface.fine, place.scans[0]
    around = transform_points(T, query.dense.points) - grid.corner
    points = (around + np.random.default_rng(5).normal(0, 0.3, around.shape)).astype(np.float32)
    near = grid.nearest(points)
    assert np.array_equal(near, reference.nearest(grid, points))
    assert 0.1 < (near >= 0).mean() < 0.9


def two_sided() -> tuple[SurfaceGrid, Surface]:
    """A slab 0.2 m thick, both faces of it mapped, and a scan of the upper one: one cell names one face."""
    rng = np.random.default_rng(8)
    points = rng.uniform([-8, -8, -0.02], [8, 8, 0.02], (8000, 3)).astype(np.float32)
    up = np.repeat([True, False], 4000)
    points[~up, 2] -= 0.2
    normals = np.where(up[:, None], np.float32([[0, 0, 1]]), np.float32([[0, 0, -1]]))
    surface = Surface(points, normals, np.ones(len(points), np.bool_))
    return SurfaceGrid.of(surface, 0.6), surface.at(slice(0, 4000, 9))


def test_both_faces_of_a_slab_are_found_as_numpy_finds_them():
    grid, scan = two_sided()
    starts = starts_around(np.eye(4), 12, 6, 0.3)
    wanted, information = reference.align(grid, scan, starts, **STEPS["coarse"])
    found = align(grid, scan, starts, **STEPS["coarse"])
    assert np.abs(found[0] - wanted).max() < 1e-4
    assert np.abs(found[0][:, 2, 3]).max() < 0.03  # all of them lie on the upper face
    np.testing.assert_allclose(found[3], information, rtol=0.01, atol=1e-4 * np.abs(information).max())


def damaged(grid: SurfaceGrid, seed: int) -> SurfaceGrid:
    """The grid with any numbers in its tables."""
    rng = np.random.default_rng(seed)
    some = {
        name: rng.integers(-(2**31), 2**31, getattr(grid, name).shape, np.int64).astype(np.int32)
        for name in ("group", "block", "point", "other_face")
        if rng.random() < 0.7
    }
    planes = grid.planes.copy()
    planes[rng.random(planes.shape) < 0.2] = rng.choice(np.float32([np.nan, np.inf, -np.inf, 3e38, -1e20]))
    return replace(grid, planes=planes, **some)


def test_a_damaged_file_gives_poses_that_are_numbers():
    grid, scan = two_sided()
    starts = starts_around(np.eye(4), 6, 3)
    for seed in range(30):
        T, ratio, score, information, _ = align(damaged(grid, seed), scan, starts, **FINE)
        for values in (T, ratio, score, information):
            assert np.isfinite(values).all()
        assert ((ratio >= 0) & (ratio <= 1)).all()


def test_invalid_poses_and_points_fit_nowhere():
    grid, scan = slab()
    starts = starts_around(np.eye(4), 8, 4)
    for number, wrong in enumerate([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e30, -1e30, 4e9]):
        starts[number, number % 3, 3] = wrong
    assert not align(grid, scan, starts, **FINE)[1].any()
    points = scan.points.copy()
    points[::2] = [[np.nan, np.inf, -np.inf]]
    ratio = align(grid, replace(scan, points=points), starts_around(np.eye(4), 1, 5, 0.01), **FINE)[1]
    assert ratio[0] <= 0.5


def test_without_points_or_poses_nothing_is_aligned():
    grid, scan = slab()
    T, ratio, score, information, _ = align(grid, scan.at(slice(0, 0)), np.eye(4)[None], **FINE)
    assert np.array_equal(T, np.eye(4)[None])
    assert not ratio.any()
    assert not score.any()
    assert not information.any()
    assert [len(values) for values in align(grid, scan, np.empty((0, 4, 4)), **FINE)] == [0] * 5


def test_tables_of_another_shape_or_type_are_refused():
    grid, scan = slab()
    for wrong in (
        {"cell": np.zeros(0, np.float32)},
        {"cell": np.zeros(1, np.float32)},
        {"cell": np.full(1, np.nan, np.float32)},
        {"planes": grid.planes[:-1]},
        {"planes": grid.planes[:0], "oriented": grid.oriented[:0], "other_face": grid.other_face[:0]},
        {"other_face": grid.other_face[:-1]},
        {"other_face": grid.other_face.astype(np.int64)},
        {"planes": grid.planes.astype(np.float64)},
        {"group": grid.group.ravel()},
        {"group": grid.group[:0]},
        {"group": np.zeros((1 << 21, 1, 1), np.int32)},  # more cells along an axis than a float counts
        {"block": grid.block[:, :3]},
        {"point": grid.point[:0]},
        {"point": np.zeros((4, 3, 3, 3), np.int32)},
        {"point": np.zeros((1, 4, 4, 2), np.int32)},
    ):
        with pytest.raises((ValueError, TypeError)):
            replace(grid, **wrong)
    with pytest.raises(ValueError, match="differ in length"):
        align(grid, replace(scan, oriented=scan.oriented[:-1]), np.eye(4)[None], **FINE)
    for wrong in (
        {"reach_m": 0.0},
        {"reach_m": np.inf},
        {"half_angle": np.nan},
        {"half_angle": -1.0},
        {"iterations": -1},
        {"iterations": 2**31 - 1},
    ):
        with pytest.raises(ValueError, match=r"not positive|iterations"):
            align(grid, scan, np.eye(4)[None], **{**FINE, **wrong})


def test_a_pickled_grid_finds_the_same():
    grid, scan = slab()
    again = pickle.loads(pickle.dumps(grid))
    assert np.array_equal(again.nearest(scan.points), grid.nearest(scan.points))


def test_distinct_poses_are_those_of_numpy():
    rng = np.random.default_rng(9)
    turns = Rotation.from_rotvec(rng.normal(0, 0.2, (80, 3))).as_matrix()
    T = np.array([make_transform(turn, rng.uniform(-2, 2, 3)) for turn in turns])
    wanted = reference.distinct_poses(T, 1.0, 15.0, len(T))
    assert 10 < len(wanted) < 70
    assert native.distinct_poses(T, 1.0, np.radians(15.0), len(T)).tolist() == wanted
    assert native.distinct_poses(T, 1.0, np.radians(15.0), 5).tolist() == wanted[:5]
