import numpy as np
import pytest

from firstfix.voxel_filter import at_most, even_rows, voxel_means, within_range


def test_means_of_every_cube_in_order():
    points = np.array([[0.1, 0.1, 0.1], [1.5, 0.5, 0.5], [0.3, 0.5, 0.9], [-0.5, 0.5, 0.5], [0.5, 0.5, -2.5]])
    wanted = [[0.5, 0.5, -2.5], [-0.5, 0.5, 0.5], [0.2, 0.3, 0.5], [1.5, 0.5, 0.5]]
    np.testing.assert_allclose(voxel_means(points, 1.0), wanted, atol=1e-6)


def test_no_points_no_means():
    assert voxel_means(np.zeros((0, 3)), 0.3).shape == (0, 3)


@pytest.mark.parametrize(("count", "at_most"), [(0, 5), (4, 5), (5, 5), (6, 5), (1000, 7)])
def test_even_rows_are_spread_over_all(count, at_most):
    rows = even_rows(count, at_most)
    assert len(rows) == min(count, at_most)
    if len(rows) > 1:
        steps = np.diff(rows)
        assert steps.min() >= 1
        assert steps.max() - steps.min() <= 1
        assert rows[0] == 0
        assert rows[-1] >= count - 1 - steps.max()


def test_means_do_not_depend_on_the_order_of_the_points():
    rng = np.random.default_rng(2)
    points = rng.normal(0, 2, (3000, 3)).astype(np.float32)
    np.testing.assert_array_equal(voxel_means(points, 0.7), voxel_means(rng.permutation(points), 0.7))


def test_within_range_and_an_even_part():
    points = np.float32([[0.4, 0, 0], [0, 0.6, 0], [3, 4, 0], [0, 0, -9]])
    assert within_range(points, 0.5, 6.0).tolist() == points[1:3].tolist()
    assert at_most(np.arange(10), 4).tolist() == [0, 3, 6, 9]
    assert at_most(np.arange(4), 4).tolist() == [0, 1, 2, 3]
