"""Reductions of scans: voxels, samples, and the view by directions."""

import numpy as np

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.scan.reduction import (
    BORDER_M,
    COLUMNS,
    ROWS,
    RangeView,
    at_most,
    rows_by_voxel_hash,
    voxel_means,
    within_range,
)


def test_voxel_means_are_those_of_every_cube_in_order():
    points = np.array([[0.1, 0.1, 0.1], [1.5, 0.5, 0.5], [0.3, 0.5, 0.9], [-0.5, 0.5, 0.5], [0.5, 0.5, -2.5]])
    wanted = [[0.5, 0.5, -2.5], [-0.5, 0.5, 0.5], [0.2, 0.3, 0.5], [1.5, 0.5, 0.5]]
    np.testing.assert_allclose(voxel_means(points, 1.0), wanted, atol=1e-6)
    assert voxel_means(np.zeros((0, 3)), 0.3).shape == (0, 3)


def test_means_do_not_depend_on_the_order_of_the_points():
    rng = np.random.default_rng(2)
    points = rng.normal(0, 2, (3000, 3)).astype(np.float32)
    np.testing.assert_array_equal(voxel_means(points, 0.7), voxel_means(rng.permutation(points), 0.7))


def test_scans_are_cut_by_range_and_count():
    points = np.float32([[0.4, 0, 0], [0, 0.6, 0], [3, 4, 0], [0, 0, -9]])
    assert within_range(points, 0.5, 6.0).tolist() == points[1:3].tolist()
    for dtype in (np.float32, np.float64):
        many = np.arange(30, dtype=dtype).reshape(10, 3)
        taken = at_most(many, 4)
        assert (taken.dtype, taken.tolist()) == (dtype, many[rows_by_chance(10, 4)].tolist())
        assert at_most(many[:4], 4).tolist() == many[:4].tolist()


def test_a_part_of_a_scan_has_all_its_beams():
    # 64 beams, one after the other in each column: as an OS0-64 or an HDL-64E sends them
    beams = np.tile(np.arange(64), 1000)
    for count in (32_000, 16_000, 4_000, 1_000):
        taken = np.bincount(beams[rows_by_chance(len(beams), count)], minlength=64)
        assert taken.min() > 0.5 * count / 64
        assert taken.max() < 1.6 * count / 64


RNG = np.random.default_rng(5)
PLACES = RNG.uniform(-20, 20, (6000, 3))


def test_a_sample_by_voxel_has_as_many_rows_as_asked():
    for at_most_rows in (1, 7, 400, 5999, 6000, 9000):
        rows = rows_by_voxel_hash(PLACES, 0.3, at_most_rows)
        assert len(rows) == min(at_most_rows, len(PLACES))
        assert (np.diff(rows) > 0).all()
    assert len(rows_by_voxel_hash(PLACES[:0], 0.3, 10)) == 0
    assert set(rows_by_voxel_hash(PLACES, 0.3, 400)) < set(rows_by_voxel_hash(PLACES, 0.3, 4000))
    inside_one = RNG.uniform(0.1, 0.2, (50, 3))
    assert rows_by_voxel_hash(inside_one, 0.3, 3).tolist() == [0, 1, 2]


def test_one_point_more_changes_one_point_of_a_sample_by_voxel():
    rows = rows_by_voxel_hash(PLACES, 0.3, 2000)
    for taken in (rows[1000], np.setdiff1d(np.arange(6000), rows)[1000]):
        fewer = np.delete(PLACES, taken, axis=0)
        again = fewer[rows_by_voxel_hash(fewer, 0.3, 2000)]
        assert len({tuple(p) for p in PLACES[rows]} - {tuple(p) for p in again}) <= 1


def test_a_sample_by_voxel_is_an_even_part():
    for axis in range(3):
        taken = np.histogram(PLACES[rows_by_voxel_hash(PLACES, 0.3, 2000), axis], 5, (-20, 20))[0]
        np.testing.assert_allclose(taken / np.histogram(PLACES[:, axis], 5, (-20, 20))[0], 1 / 3, atol=0.05)


def test_the_sample_by_voxel_is_that_of_the_protocol():
    """Computed by hand from clients/protocol/on-the-robot.md: every client must take these."""
    means = np.array([[0.1, 0.1, 0.1], [0.4, 0.1, 0.1], [-0.1, 0.1, 0.7], [5.0, -3.0, 1.0], [0.3, 0.3, 0.3]])

    def hashed(x: int, y: int, z: int) -> int:
        h = (x * 19349663 ^ y * 83492791 ^ z * 73856093) % 2**32
        h = (h ^ h >> 16) * 0x85EBCA6B % 2**32
        h = (h ^ h >> 13) * 0xC2B2AE35 % 2**32
        return h ^ h >> 16

    voxels = [
        (0, 0, 0),
        (1, 0, 0),
        (-1, 0, 2),
        (16, -11, 3),
        (0, 0, 0),
    ]  # 0.3 lies before the border at 0.3005
    order = sorted(range(5), key=lambda row: (hashed(*voxels[row]), row))
    for at_most_rows in range(1, 5):
        assert rows_by_voxel_hash(means, 0.3, at_most_rows).tolist() == sorted(order[:at_most_rows])


def test_points_in_whole_millimetres_lie_on_no_border():
    """Half of these points lie on multiples of the voxel's size: there, any movement would change voxels."""
    points = np.round(RNG.uniform(-5, 5, (2000, 3)) / 0.25) * 0.25
    points += RNG.integers(0, 2, points.shape) * 0.001
    for nudge_m in (-1e-5, 1e-5):
        moved = voxel_means(points + nudge_m, 0.25, BORDER_M)
        np.testing.assert_allclose(moved, voxel_means(points, 0.25, BORDER_M) + nudge_m, atol=2e-6)


def nearest(rows, columns=slice(None)) -> np.ndarray:
    """(cells,) ranges with returns in some rows and columns."""
    image = np.full((ROWS, COLUMNS), np.inf, np.float32)
    image[rows, columns] = 4.0
    return image.ravel()


def counted(of_nearest: np.ndarray) -> np.ndarray:
    return RangeView.of_nearest(of_nearest).returned.reshape(ROWS, COLUMNS)


def test_the_edges_of_the_field_of_view_do_not_count():
    found = counted(nearest(slice(40, 52)))
    assert np.array_equal(found, np.isfinite(nearest(slice(41, 51))).reshape(ROWS, COLUMNS))
    assert found[45].all()  # columns wrap around


def test_directions_beside_a_hole_do_not_count():
    image = nearest(slice(30, 60)).reshape(ROWS, COLUMNS).copy()
    image[44:47, 100:103] = np.inf
    found = counted(image.ravel())
    assert not found[43:48, 101].any()
    assert found[43, 99]  # the corner has eight of nine
    assert found[42, 101]


def test_in_a_scan_of_single_rows_each_direction_counts():
    sparse = nearest(slice(40, 52, 2))
    assert np.array_equal(counted(sparse).ravel(), np.isfinite(sparse))


def test_an_empty_view_counts_nothing():
    assert not counted(nearest(slice(0, 0))).any()


def test_the_nearest_range_is_that_of_the_cell_and_those_around():
    image = nearest(slice(None)).reshape(ROWS, COLUMNS).copy()
    image[20, 0] = 1.0
    least = RangeView.of_nearest(image.ravel()).least.reshape(ROWS, COLUMNS)
    assert np.argwhere(least == 1.0).tolist() == [[r, c] for r in (19, 20, 21) for c in (0, 1, COLUMNS - 1)]
