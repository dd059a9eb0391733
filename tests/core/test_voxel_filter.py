import numpy as np
import pytest

from firstfix.voxel_filter import even_rows, voxel_means


def test_means_of_every_cube_in_order():
    points = np.array([[0.1, 0.1, 0.1], [1.5, 0.5, 0.5], [0.3, 0.5, 0.9], [-0.5, 0.5, 0.5], [0.5, 0.5, -2.5]])
    wanted = [[0.5, 0.5, -2.5], [-0.5, 0.5, 0.5], [0.2, 0.3, 0.5], [1.5, 0.5, 0.5]]
    np.testing.assert_allclose(voxel_means(points, 1.0), wanted)


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
