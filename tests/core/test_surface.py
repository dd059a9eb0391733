import numpy as np

from firstfix.surface import Surface


def test_normals_of_a_plane_and_a_wall():
    rng = np.random.default_rng(1)
    floor = np.column_stack([rng.uniform(-3, 3, (800, 2)), np.zeros(800)])
    wall = np.column_stack([np.full(800, 20.0), rng.uniform(-3, 3, (800, 2))])
    surface = Surface.around(np.concatenate([floor, wall]))
    assert surface.points.dtype == surface.normals.dtype == np.float32
    assert np.allclose(np.abs(surface.normals[:800]), [0, 0, 1], atol=1e-3)
    assert np.allclose(np.abs(surface.normals[800:]), [1, 0, 0], atol=1e-3)


def test_a_part_has_at_most_so_many_points_and_keeps_their_normals():
    points = np.arange(300, dtype=np.float32).reshape(100, 3)
    surface = Surface(points, points + 1)
    for count in (1, 7, 33, 99, 100, 1000):
        part = surface.at_most(count)
        assert 0 < len(part) <= count
        assert np.array_equal(part.normals, part.points + 1)
    assert len(surface.at_most(1000)) == 100
