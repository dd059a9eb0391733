import numpy as np

from firstfix.scan.voxel_filter import at_most, voxel_means, within_range


def test_means_of_every_cube_in_order():
    points = np.array([[0.1, 0.1, 0.1], [1.5, 0.5, 0.5], [0.3, 0.5, 0.9], [-0.5, 0.5, 0.5], [0.5, 0.5, -2.5]])
    wanted = [[0.5, 0.5, -2.5], [-0.5, 0.5, 0.5], [0.2, 0.3, 0.5], [1.5, 0.5, 0.5]]
    np.testing.assert_allclose(voxel_means(points, 1.0), wanted, atol=1e-6)


def test_no_points_no_means():
    assert voxel_means(np.zeros((0, 3)), 0.3).shape == (0, 3)


def test_means_do_not_depend_on_the_order_of_the_points():
    rng = np.random.default_rng(2)
    points = rng.normal(0, 2, (3000, 3)).astype(np.float32)
    np.testing.assert_array_equal(voxel_means(points, 0.7), voxel_means(rng.permutation(points), 0.7))


def test_within_range_and_a_part():
    points = np.float32([[0.4, 0, 0], [0, 0.6, 0], [3, 4, 0], [0, 0, -9]])
    assert within_range(points, 0.5, 6.0).tolist() == points[1:3].tolist()
    assert len(at_most(np.arange(10), 4)) == 4
    assert at_most(np.arange(4), 4).tolist() == [0, 1, 2, 3]


def test_a_part_of_a_scan_has_all_its_beams():
    # 64 beams, one after the other in each column: as an OS0-64 or an HDL-64E sends them
    beams = np.tile(np.arange(64), 1000)
    for count in (32_000, 16_000, 4_000, 1_000):
        taken = np.bincount(at_most(beams, count), minlength=64)
        assert taken.min() > 0.5 * count / 64
        assert taken.max() < 1.6 * count / 64
