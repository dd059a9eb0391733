from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import BuildFailed
from firstfix_builder.mesh.clean_cloud import (
    CleanConfig,
    clean_cloud,
    point_spacing_m,
    surface_spacings_m,
    voxel_means,
    without_strays,
)


def grid_cloud(step_m: float = 0.1, edge: int = 60) -> np.ndarray:
    x, y = np.meshgrid(np.arange(edge) * step_m, np.arange(edge) * step_m)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def test_strays_and_broken_points_go_and_the_surface_stays():
    cloud = grid_cloud()
    strays = np.array([[3.0, 3.0, 2.0], [3.0, 3.1, 2.0], [-4.0, 0.0, 0.0]])
    broken = np.array([[np.nan, 0, 0], [0, np.inf, 0]])
    cleaned = clean_cloud(np.concatenate([broken, strays, cloud]), CleanConfig(voxel_m=None))
    np.testing.assert_array_equal(cleaned, cloud)


def test_a_map_with_a_point_beyond_all_others_is_refused_in_words():
    with pytest.raises(BuildFailed, match="too large for neighbourhoods of"):
        without_strays(np.array([[0.0, 0, 0], [0.1, 0, 0], [3e6, 0, 0]]), 0.1, 1)


def test_nothing_is_a_stray_when_no_neighbour_is_asked_for():
    cloud = np.concatenate([grid_cloud(), [[0, 0, 9.0]]])
    assert len(clean_cloud(cloud, CleanConfig(voxel_m=None, min_neighbours=0))) == len(cloud)


def test_voxel_means_are_the_means():
    points = np.array([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [-0.1, 0.1, 0.1]])
    np.testing.assert_allclose(voxel_means(points, 0.5), [[-0.1, 0.1, 0.1], [0.2, 0.1, 0.1]])


def test_the_order_of_the_points_does_not_matter():
    cloud = grid_cloud(0.03) + np.random.default_rng(0).normal(0, 0.01, (3600, 3))
    shuffled = np.random.default_rng(1).permutation(cloud)
    np.testing.assert_allclose(clean_cloud(cloud, CleanConfig()), clean_cloud(shuffled, CleanConfig()))


def test_a_cloud_over_the_limit_is_thinned_evenly():
    cleaned = clean_cloud(grid_cloud(0.05, 100), CleanConfig(max_points=2_000))
    assert 1_000 < len(cleaned) <= 2_000
    assert point_spacing_m(cleaned) == pytest.approx(0.1, rel=0.4)


def test_spacing_of_a_raster():
    assert point_spacing_m(grid_cloud(0.25)) == pytest.approx(0.25)
    assert np.median(surface_spacings_m(grid_cloud(0.25))) == pytest.approx(0.25)


def test_surface_spacing_of_random_points_is_that_of_as_many_points_in_a_raster():
    points = np.random.default_rng(0).random((40_000, 3)) * [20, 20, 0]
    assert np.median(surface_spacings_m(points)) == pytest.approx(0.1, rel=0.2)
    assert point_spacing_m(points) < 0.06


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((10, 3), np.nan), np.zeros((50, 3))])
def test_a_map_without_content_is_refused(points: np.ndarray):
    with pytest.raises(BuildFailed):
        clean_cloud(points, CleanConfig(voxel_m=None))
