"""Kernels of the motion during a scan beside NumPy, and with tables and times that are damaged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix import native
from firstfix.engine.ranking import RANKING
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.transform import make_transform, pose_error, rotation_z
from tests.core.engine.fixtures import slab
from tests.reference import motion as reference
from tests.reference import registration
from tests.reference.recorded_places import RecordedPlace

FINE = {"iterations": 12, "reach_m": 0.5, "half_angle": 0.2}
TWIST_SCALE = np.array(RANKING.twist_scale)
TWIST = np.array([1.3, -0.4, 0.05, 0.1, -0.2, 1.7])


def times_by_azimuth(points: np.ndarray) -> np.ndarray:
    """Times (n,) of a sensor that turns clockwise in 0.1 s and is half round at the stamp."""
    return (-np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) * 0.1).astype(np.float32)


def align_moving(
    grid: SurfaceGrid, scan: Surface, starts: np.ndarray, scale=TWIST_SCALE, twists=None, **parameters
):
    return native.align_moving(
        grid.tables,
        scan.points,
        scan.normals,
        scan.oriented,
        scan.time_s,
        starts,
        np.zeros((len(starts), 6)) if twists is None else twists,
        scale,
        inlier_distance_m=0.15,
        **{**FINE, **parameters},
    )


def skewed(scan: Surface, twist: np.ndarray) -> Surface:
    """A still scan as it would be had the sensor moved, each point at the time of its azimuth."""
    timed = replace(scan, time_s=-times_by_azimuth(scan.points))  # back in time is the inverse motion
    return replace(reference.deskewed(timed, twist), time_s=-timed.time_s)


def test_points_are_deskewed_as_by_the_matrix_exponential():
    rng = np.random.default_rng(1)
    points = rng.uniform(-30, 30, (500, 3)).astype(np.float32)
    time_s = rng.uniform(-1, 1, 500).astype(np.float32)
    time_s[:3] = 0, 1e-9, 1e-5
    for twist in (TWIST, np.zeros(6), np.array([9.0, 0, 0, 0, 0, 1e-7]), np.array([1.0, 2, 3, 6, -5, 4])):
        surface = Surface(points, points, np.zeros(500, np.bool_), time_s)
        wanted = reference.deskewed(surface, twist).points
        np.testing.assert_allclose(native.deskew(points, time_s, twist), wanted, atol=2e-5)


@pytest.mark.parametrize("scale", [TWIST_SCALE, np.ones(6)], ids=["planar", "all axes"])
def test_poses_and_twists_are_those_of_numpy(place: RecordedPlace, scale: np.ndarray):
    grid = place.surface.fine
    rng = np.random.default_rng(3)
    for query, T in place.scans:
        scan = skewed(query.dense, TWIST)
        turn = Rotation.from_rotvec(rng.normal(0, 0.02, 3)).as_matrix()
        start = T @ make_transform(turn, rng.uniform(-0.1, 0.1, 3))
        wanted, information, twist = reference.align_moving(grid, scan, start, np.zeros(6), scale, **FINE)
        found = align_moving(grid, scan, start[None], scale)
        metres, degrees = pose_error(wanted, found[0][0])
        assert metres < 0.003
        assert degrees < 0.03
        np.testing.assert_allclose(found[-1][0], twist, atol=0.03)
        np.testing.assert_allclose(found[3][0], information, rtol=0.05, atol=0.05 * np.abs(information).max())
        seen = reference.deskewed(scan, found[-1][0])
        ratio, score = registration.quality(grid, seen, found[0], 0.15)
        assert abs(found[1] - ratio).max() < 1e-3
        assert abs(found[2] - score).max() < 1e-3


@pytest.mark.parametrize("known", [np.zeros(6), TWIST + 0.2], ids=["from rest", "from a twist"])
def test_one_step_is_that_of_numpy(place: RecordedPlace, known: np.ndarray):
    query, T = place.scans[0]
    scan = skewed(query.dense, TWIST)
    wanted, information, twist = reference.align_moving(
        place.surface.fine, scan, T, known, TWIST_SCALE, **{**FINE, "iterations": 1}
    )
    found = align_moving(place.surface.fine, scan, T[None], twists=known[None], iterations=1)
    np.testing.assert_allclose(found[0][0], wanted, atol=1e-5)
    np.testing.assert_allclose(found[-1][0], twist, atol=1e-3)
    np.testing.assert_allclose(found[3][0], information, atol=1e-4 * np.abs(information).max())


def test_a_pose_is_aligned_to_the_same_bits_alone_and_among_others(place: RecordedPlace):
    query, T = place.scans[0]
    scan = skewed(query.sparse, TWIST)
    starts = np.array([T @ make_transform(rotation_z(a), [a, -a, 0]) for a in (0, 0.03, -0.05, 0.1)])
    together = align_moving(place.surface.fine, scan, starts)
    for number in range(4):
        alone = align_moving(place.surface.fine, scan, starts[number : number + 1])
        for one, all_of_them in zip(alone, together, strict=True):
            assert np.array_equal(one[0], all_of_them[number])


def timed_slab() -> tuple[SurfaceGrid, Surface]:
    grid, scan = slab(2000)
    return grid, replace(scan, time_s=times_by_azimuth(scan.points))


def test_a_floor_shows_no_motion():
    grid, scan = timed_slab()
    T, ratio, _, information, rests, twist = align_moving(grid, scan, np.eye(4)[None])
    assert pose_error(T[0], np.eye(4))[0] < 0.02
    assert ratio[0] > 0.95
    assert rests[0]
    assert np.abs(twist).max() < 0.05
    assert np.isfinite(information).all()


def test_without_points_or_poses_there_is_no_motion():
    grid, scan = timed_slab()
    T, *_, twist = align_moving(grid, scan.at(slice(0, 0)), np.eye(4)[None])
    assert np.array_equal(T, np.eye(4)[None])
    assert not twist.any()
    assert [len(values) for values in align_moving(grid, scan, np.empty((0, 4, 4)))] == [0] * 6


def test_damaged_tables_give_numbers():
    grid, scan = timed_slab()
    rng = np.random.default_rng(4)
    for _ in range(20):
        planes = grid.planes.copy()
        wrong = np.float32([np.nan, np.inf, -np.inf, 3e38, -1e20])
        planes[rng.random(planes.shape) < 0.2] = rng.choice(wrong)
        for values in align_moving(replace(grid, planes=planes), scan, np.eye(4)[None]):
            assert np.isfinite(values).all()


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -101.0])
def test_invalid_times_are_refused(wrong: float):
    grid, scan = timed_slab()
    times = scan.time_s.copy()
    times[5] = wrong
    with pytest.raises(ValueError, match="100 s"):
        align_moving(grid, replace(scan, time_s=times), np.eye(4)[None])
    with pytest.raises(ValueError, match="100 s"):
        native.deskew(scan.points, times, np.zeros(6))
    with pytest.raises(ValueError, match="one time for each"):
        native.deskew(scan.points, times[:-1], np.zeros(6))


def test_twists_and_scales_out_of_range_are_refused():
    grid, scan = timed_slab()
    for wrong in (np.full(6, np.nan), np.full(6, 101.0), np.array([0, 0, 0, 0, 0, 21.0])):
        with pytest.raises(ValueError, match="too fast"):
            native.deskew(scan.points, scan.time_s, wrong)
        with pytest.raises(ValueError, match="too fast"):
            align_moving(grid, scan, np.eye(4)[None], twists=wrong[None])
    with pytest.raises(ValueError, match="differ in length"):
        align_moving(grid, scan, np.eye(4)[None], twists=np.zeros((2, 6)))
    for wrong in (np.zeros(6), np.full(6, np.nan), -np.ones(6)):
        with pytest.raises(ValueError, match="not positive"):
            align_moving(grid, scan, np.eye(4)[None], wrong)


def test_an_unlikely_motion_takes_from_the_score():
    assert RANKING.discounted_score(0.8, None) == 0.8
    assert RANKING.discounted_score(0.8, np.zeros(6)) == pytest.approx(0.8)
    scores = [
        RANKING.discounted_score(0.8, np.array([v, 0, 0, 0, 0, 0.0])) for v in (0.5, 1.0, 3.0, 8.0, 100.0)
    ]
    assert scores == sorted(scores, reverse=True)
    assert scores[1] > 0.78
    assert scores[2] == pytest.approx(1.05 - 0.25 * 2 ** (1 / 2.5))
    assert scores[-1] == 0
    turning = [RANKING.discounted_score(0.8, np.array([0, 0, 0, 0, 0, w])) for w in (1.0, 2.0, 4.0)]
    assert turning[2] == pytest.approx(scores[2])
    assert turning[0] > turning[1] > turning[2]
