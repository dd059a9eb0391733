"""PCA-SC and CNZ against a slow reading of the paper, cell by cell."""

import math

import numpy as np
import pytest

from firstfix.descriptor import cnz, describe, principal_axes
from firstfix.polar import PolarGrid

GRID = PolarGrid(20, 60, 30.0)


def a_scan(seed: int, points: int = 2000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    stretched = rng.normal(0, [9, 4, 1.0], (points, 3)) + [1.5, 0.5, 0.5]
    return stretched.astype(np.float32)


def slow_pca_sc(points, height_m, grid):
    """Paper III.A, written for reading."""
    near = [p for p in points.astype(float) if math.hypot(p[0], p[1]) < grid.max_range_m]
    xy = np.array([p[:2] for p in near])
    values, vectors = np.linalg.eigh(np.cov(xy.T, bias=True))
    axis = vectors[:, 1]
    if axis @ xy.mean(axis=0) < 0:
        axis = -axis
    angle = math.atan2(axis[1], axis[0])
    context = np.zeros((grid.rings, grid.sectors))
    for x, y, z in near:
        ring = int(math.hypot(x, y) / grid.max_range_m * grid.rings)
        turn = (math.atan2(y, x) - angle) % (2 * math.pi)
        sector = int(turn / (2 * math.pi) * grid.sectors) % grid.sectors
        context[ring, sector] = max(context[ring, sector], z + height_m)
    return angle, values[0] / values[1], context


@pytest.mark.parametrize("seed", range(5))
def test_equals_the_slow_reference(seed):
    points = a_scan(seed)
    got = describe(points, np.zeros(len(points), np.intp), 1, np.array([1.2], np.float32), GRID)
    angle, ratio, context = slow_pca_sc(points, 1.2, GRID)
    assert got.angle_rad[0] == pytest.approx(angle, abs=1e-4)
    assert got.ratio[0] == pytest.approx(ratio, abs=1e-4)
    # float32 may put a point that lies on a cell's edge into the neighbour
    assert np.mean(~np.isclose(got.context[0], context, atol=1e-4)) < 0.005


def test_a_batch_is_its_scans_one_by_one():
    scans = [a_scan(seed, 500 + 100 * seed) for seed in range(4)]
    of_scan = np.concatenate([np.full(len(s), i) for i, s in enumerate(scans)])
    heights = np.array([1.0, 1.2, 0.4, 2.0], np.float32)
    together = describe(np.concatenate(scans), of_scan, 4, heights, GRID)
    for i, points in enumerate(scans):
        alone = describe(points, np.zeros(len(points), np.intp), 1, heights[i : i + 1], GRID)
        assert np.array_equal(together.context[i], alone.context[0])
        assert together.angle_rad[i] == alone.angle_rad[0]


@pytest.mark.parametrize("turn_deg", [1, 37, 90, 180, -120])
def test_turning_the_robot_turns_the_axis_and_keeps_the_context(turn_deg):
    points = a_scan(7)
    turn = math.radians(turn_deg)
    R = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
    turned = (points @ R.T).astype(np.float32)
    of_scan, height = np.zeros(len(points), np.intp), np.ones(1, np.float32)
    a, b = describe(points, of_scan, 1, height, GRID), describe(turned, of_scan, 1, height, GRID)
    off = (b.angle_rad[0] - a.angle_rad[0] - turn + math.pi) % (2 * math.pi) - math.pi
    assert abs(off) < 1e-4
    assert np.mean(~np.isclose(a.context, b.context, atol=1e-3)) < 0.01
    assert np.allclose(cnz(a.context), cnz(b.context), atol=1.01 / 60)


def test_cnz_is_the_share_of_filled_sectors():
    context = np.zeros((1, 3, 4), np.float32)
    context[0, 1, :3] = 2.0
    context[0, 2] = 0.1
    assert cnz(context).tolist() == [[0, 0.75, 1]]


def test_a_scan_without_points_has_no_axis():
    angle, ratio = principal_axes(np.empty((0, 3), np.float32), np.empty(0, np.intp), 2, 30.0)
    assert angle.tolist() == [0, 0]
    assert ratio.tolist() == [1, 1]


def test_points_on_the_grid_s_edges_stay_inside():
    edge = np.nextafter(np.float32(30), np.float32(0))
    x = np.array([edge, -edge, 0, 0, 30, 1e-20], np.float32)
    y = np.array([0, -0.0, edge, -edge, 0, -1e-20], np.float32)
    inside, cell = GRID.cells(x, y)
    assert inside.tolist() == [0, 1, 2, 3, 5]
    assert ((cell >= 0) & (cell < 20 * 60)).all()
