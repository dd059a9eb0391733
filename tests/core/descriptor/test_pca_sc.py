"""PCA-SC and CNZ, compared with slow code written after the paper, cell by cell."""

import math

import numpy as np
import pytest

from firstfix.descriptor import PolarGrid, ScanBatch
from firstfix.descriptor.pca_sc import PcaScanContext
from firstfix.descriptor.principal_axes import principal_axes

GRID = PolarGrid(20, 60, 30.0)
VARIANTS = [(origin, ground) for origin in ("floor", "sensor") for ground in ("raw", "keep", "drop")]


def a_scan(seed: int, points: int = 2000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    stretched = rng.normal(0, [9, 4, 1.0], (points, 3)) + [1.5, 0.5, 0.5]
    return stretched.astype(np.float32)


def slow_pca_sc(points, height_m, how):
    """Paper III.A in slow and readable code."""
    grid = how.grid
    near = [p for p in points.astype(float) if math.hypot(p[0], p[1]) < grid.max_range_m]
    xy = np.array([p[:2] for p in near])
    values, vectors = np.linalg.eigh(np.cov(xy.T, bias=True))
    axis = vectors[:, 1]
    if axis @ xy.mean(axis=0) < 0:
        axis = -axis
    angle = math.atan2(axis[1], axis[0])
    context = np.zeros((grid.rings, grid.sectors))
    for x, y, z in near:
        above_floor = z + height_m
        if how.ground == "drop" and above_floor <= how.ground_m:
            continue
        height = above_floor if how.height_origin == "floor" else z
        if how.ground == "keep":
            height = max(height, 0.01)
        ring = int(math.hypot(x, y) / grid.max_range_m * grid.rings)
        turn = (math.atan2(y, x) - angle) % (2 * math.pi)
        sector = int(turn / (2 * math.pi) * grid.sectors) % grid.sectors
        context[ring, sector] = max(context[ring, sector], height)
    return angle, values[0] / values[1], context


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("origin", "ground"), VARIANTS)
@pytest.mark.parametrize("grid", [GRID, PolarGrid(7, 24, 12.5)])
def test_a_description_is_that_of_the_slow_reference(seed, origin, ground, grid):
    how = PcaScanContext(grid, height_origin=origin, ground=ground, ground_m=0.4)
    points = a_scan(seed)
    got = how.describe(ScanBatch.single(points, 1.2))
    angle, ratio, context = slow_pca_sc(points, 1.2, how)
    assert got["angle_rad"][0] == pytest.approx(angle, abs=1e-4)
    assert got["ratio"][0] == pytest.approx(ratio, abs=1e-4)
    # float32 may put a point that lies on a cell's edge into the neighbour
    assert np.mean(~np.isclose(got["context"][0], context, rtol=1e-3, atol=1e-3)) < 0.005
    assert set(got) == set(how.arrays)


def test_a_batch_is_its_scans_one_by_one():
    how = PcaScanContext(GRID)
    scans = [a_scan(seed, 500 + 100 * seed) for seed in range(4)] + [np.empty((0, 3), np.float32)]
    start = np.concatenate([[0], np.cumsum([len(s) for s in scans])])
    heights = np.array([1.0, 1.2, 0.4, 2.0, 1.0], np.float32)
    together = how.describe(ScanBatch(np.concatenate(scans), start, heights))
    for i, points in enumerate(scans):
        alone = how.describe(ScanBatch.single(points, heights[i]))
        for name in how.arrays:
            assert np.array_equal(together[name][i], alone[name][0])


@pytest.mark.parametrize("turn_deg", [1, 37, 90, 180, -120])
def test_turning_the_robot_turns_the_axis_and_keeps_the_context(turn_deg):
    how, points, turn = PcaScanContext(GRID), a_scan(7), math.radians(turn_deg)
    R = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
    a = how.describe(ScanBatch.single(points, 1.0))
    b = how.describe(ScanBatch.single((points @ R.T).astype(np.float32), 1.0))
    off = (b["angle_rad"][0] - a["angle_rad"][0] - turn + math.pi) % (2 * math.pi) - math.pi
    assert abs(off) < 1e-4
    assert np.mean(~np.isclose(a["context"], b["context"], atol=1e-2)) < 0.01
    assert np.allclose(how.keys(a), how.keys(b), atol=1.01 / 60)


@pytest.mark.parametrize("turn_deg", [0, 20, 133, -90])
@pytest.mark.parametrize("trusted", [True, False])
def test_match_gives_the_yaw_of_the_query_in_the_template(turn_deg, trusted):
    """With a trusted axis by comparing directly, else by the best of all shifts (equation 6)."""
    how = PcaScanContext(GRID, max_ratio=1.0 if trusted else 0.0, trusted_shifts=0)
    points, turn = a_scan(9), math.radians(turn_deg)
    c, s = math.cos(turn), math.sin(turn)
    R_template_query = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    template = how.describe(ScanBatch.single(points, 1.0))
    query = how.describe(ScanBatch.single((points @ R_template_query).astype(np.float32), 1.0))
    yaw, score = how.match(query, template, np.arange(1))
    off = (yaw[0] - turn + math.pi) % (2 * math.pi) - math.pi
    assert abs(off) < 1e-3
    assert score[0] > 0.98


def test_a_wrong_axis_is_found_by_shifting():
    how = PcaScanContext(GRID, max_ratio=0.0)
    template = how.describe(ScanBatch.single(a_scan(3), 1.0))
    query = {**template, "context": np.roll(template["context"], -13, axis=2)}
    yaw, score = how.match(query, template, np.arange(1))
    assert yaw[0] == pytest.approx(13 * 2 * math.pi / 60, abs=1e-5)
    assert score[0] == pytest.approx(1, abs=1e-5)
    assert PcaScanContext(GRID, max_ratio=1.0).match(query, template, np.arange(1))[1][0] < 0.95


def test_a_scan_without_points_has_no_axis():
    nothing = ScanBatch(np.empty((0, 3), np.float32), np.zeros(3, np.intp), np.ones(2, np.float32))
    angle, ratio = principal_axes(nothing, 30.0)
    assert angle.tolist() == [0, 0]
    assert ratio.tolist() == [1, 1]


def test_points_on_the_grid_s_edges_stay_inside():
    edge = np.nextafter(np.float32(30), np.float32(0))
    x = np.array([edge, -edge, 0, 0, 30, 1e-20], np.float32)
    y = np.array([0, -0.0, edge, -edge, 0, -1e-20], np.float32)
    inside, cell = GRID.cells_of(x, y)
    assert inside.tolist() == [0, 1, 2, 3, 5]
    assert ((cell >= 0) & (cell < 20 * 60)).all()
