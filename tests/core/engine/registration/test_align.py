"""Alignment in a room of known walls: final pose, quality and information."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.transform import make_transform, pose_error, rotation_z

CONFIG = RegistrationConfig(map_voxel_m=0.1, coarse_voxel_m=0.5, fine_distance_m=0.4, inlier_distance_m=0.13)


def wall(start, end, height=3.0, step=0.09) -> np.ndarray:
    start, end = np.array(start, float), np.array(end, float)
    along = np.arange(0, np.linalg.norm(end - start), step)
    up = np.arange(0, height, step)
    direction = (end - start) / np.linalg.norm(end - start)
    at = start + along[:, None] * direction
    return np.column_stack([np.repeat(at, len(up), axis=0), np.tile(up, len(at))])


def floor(x, y, step=0.09) -> np.ndarray:
    grid = np.stack(np.meshgrid(np.arange(*x, step), np.arange(*y, step)), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.zeros(len(grid))])


ROOM = np.concatenate(
    [
        wall((0, 0), (12, 0)),
        wall((12, 0), (12, 7)),
        wall((12, 7), (5, 7)),
        wall((5, 7), (5, 5)),  # a corner that makes it unlike itself turned half round
        wall((5, 5), (0, 5)),
        wall((0, 5), (0, 0)),
        floor((0, 12), (0, 7)),
    ]
)
TRUE = make_transform(rotation_z(0.7), [4.0, 2.5, 1.0])


def scan_of(points: np.ndarray, T_level_sensor: np.ndarray, noise_m: float = 0.01, every: int = 9) -> Surface:
    rng = np.random.default_rng(6)
    seen = (points - T_level_sensor[:3, 3]) @ T_level_sensor[:3, :3]
    return Surface.around(seen[::every] + rng.normal(0, noise_m, (len(seen[::every]), 3)))


@pytest.fixture(scope="module")
def room() -> MapSurface:
    return MapSurface.of(Surface.around(ROOM), CONFIG)


@pytest.mark.parametrize("seed", range(5))
def test_all_starts_within_half_a_metre_end_at_the_truth(room, seed):
    rng = np.random.default_rng(seed)
    turns = [Rotation.from_rotvec(rng.uniform(-0.08, 0.08, 3)).as_matrix() for _ in range(8)]
    starts = np.array([TRUE @ make_transform(turn, rng.uniform(-0.3, 0.3, 3)) for turn in turns])
    scan = scan_of(ROOM, TRUE)
    aligned = room.align(scan.at_most(400, 0.25), room.align_coarse(scan, starts)[0])
    fine = room.align_fine(scan, np.array([r.T_level_sensor for r in aligned]))
    for registration in fine:
        metres, degrees = pose_error(TRUE, registration.T_level_sensor)
        assert metres < 0.005
        assert degrees < 0.05
        assert registration.inlier_ratio > 0.99
        assert registration.alignment_score > 0.95


def test_a_wrong_place_is_told_by_its_measures(room):
    scan = scan_of(ROOM, TRUE)
    right, wrong = room.align_fine(scan, np.array([TRUE, make_transform(rotation_z(2.5), [9.0, 1.5, 1.0])]))
    assert wrong.inlier_ratio < right.inlier_ratio - 0.2
    assert wrong.alignment_score < right.alignment_score - 0.2


def test_far_from_the_map_nothing_moves_and_nothing_fits(room):
    scan, nowhere = scan_of(ROOM, TRUE), make_transform(np.eye(3), [500.0, 0, 0])
    (found,) = room.align(scan, room.align_coarse(scan, nowhere[None])[0])
    assert np.allclose(found.T_level_sensor, nowhere)
    assert found.inlier_ratio == found.alignment_score == 0
    assert np.isfinite(found.information).all()


def test_a_third_of_the_scan_that_the_map_lacks_does_not_pull(room):
    rng = np.random.default_rng(8)
    clutter = rng.uniform([3, 1.5, 0.2], [5, 3.5, 1.8], (len(ROOM) // 2, 3))
    scan = scan_of(np.concatenate([ROOM, clutter]), TRUE)
    start = TRUE @ make_transform(np.eye(3), [0.1, 0.1, 0.0])
    (found,) = room.align_fine(scan, start[None])
    assert pose_error(TRUE, found.T_level_sensor)[0] < 0.01
    assert 0.6 < found.inlier_ratio < 0.75


def test_a_corridor_fixes_its_width_and_not_its_length():
    corridor = np.concatenate([wall((0, 0), (60, 0)), wall((0, 2), (60, 2)), floor((0, 60), (0, 2))])
    surface = MapSurface.of(Surface.around(corridor), CONFIG)
    at = make_transform(np.eye(3), [30.0, 1.0, 1.0])
    near = corridor[np.abs(corridor[:, 0] - 30) < 8]
    start = at @ make_transform(np.eye(3), [0.1, 0.05, 0.02])
    (found,) = surface.align_fine(scan_of(near, at), start[None])
    off = found.T_level_sensor[:3, 3] - at[:3, 3]
    assert np.abs(off[1:]).max() < 0.005
    assert off[0] == pytest.approx(0.1, abs=0.1)  # only noise pulls it along: it stays near where it began
    assert found.rests
    along, across = found.information[3, 3], found.information[4, 4]
    assert across > 50 * along


def test_an_alignment_that_creeps_comes_to_rest_at_the_truth():
    """A long corridor with one niche: a few points face along it, and pull a few centimetres an iteration."""
    niche = [wall((30, 2), (30, 2.4), 1.0), wall((30.8, 2), (30.8, 2.4), 1.0)]
    long = [wall((0, 0), (60, 0)), wall((0, 2), (60, 2)), floor((0, 60), (0, 2))]
    corridor = np.concatenate([*long, *niche])
    surface = MapSurface.of(Surface.around(corridor), CONFIG)
    at = make_transform(np.eye(3), [30.0, 1.0, 1.0])
    scan = scan_of(corridor[np.abs(corridor[:, 0] - 30) < 15], at)
    start = (at @ make_transform(np.eye(3), [0.2, 0.02, 0.0]))[None]
    (found,) = surface.align_fine(scan, start)
    assert found.rests
    assert pose_error(at, found.T_level_sensor)[0] < 0.02
    (moving,) = surface.align(scan, start)  # of four iterations
    assert not moving.rests
    assert pose_error(at, moving.T_level_sensor)[0] > 0.03


def test_an_alignment_that_goes_to_and_fro_comes_to_rest_between(room):
    """Sparse, noisy scans with clutter: some have two poses that are each best for the pairs of the other."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        few = rng.choice(len(ROOM), 150, replace=False)
        seen = (ROOM[few] - TRUE[:3, 3]) @ TRUE[:3, :3] + rng.normal(0, 0.05, (150, 3))
        scan = Surface.around(np.concatenate([seen, rng.uniform([-3, -2, -0.8], [3, 2, 1.5], (60, 3))]))
        start = TRUE @ make_transform(np.eye(3), rng.uniform(-0.1, 0.1, 3))
        (found,) = room.align_fine(scan, start[None])
        assert found.rests
        assert pose_error(TRUE, found.T_level_sensor)[0] < 0.1


def test_screening_tells_starts_near_the_truth_from_others(room):
    """Half a metre and 8 degrees off is nearer to the truth after two steps; elsewhere nothing fits."""
    rng = np.random.default_rng(9)
    near = np.array(
        [
            make_transform(rotation_z(rng.uniform(-0.14, 0.14)), rng.uniform(-0.35, 0.35, 3) * [1, 1, 0.3])
            for _ in range(40)
        ]
    )
    far = np.array(
        [make_transform(rotation_z(rng.uniform(1.5, 5)), [*rng.uniform(-3, 3, 2), 0]) for _ in range(300)]
    )
    starts = np.concatenate([TRUE @ near, TRUE @ far])
    moved, score = room.screen(scan_of(ROOM, TRUE), starts)
    assert np.median(score[:40]) > np.quantile(score[40:], 0.95)
    off_m = np.linalg.norm(moved[:40, :3, 3] - TRUE[:3, 3], axis=1)
    assert np.median(off_m) < 0.5 * np.median(np.linalg.norm(starts[:40, :3, 3] - TRUE[:3, 3], axis=1))
    assert 0 <= score.min() <= score.max() <= 1
