"""Kernels of an answer's covariance, against NumPy and LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

import firstfix.native as native
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.transform import make_transform, rotation_z
from tests.native.kernel_cases import FEW, SURFACE, T_MAP_SENSOR
from tests.reference import covariance as reference
from tests.reference.facing import faced_information, principal_axes, told_in
from tests.reference.verdict_in_steps import free_directions

TURNED = make_transform(rotation_z(0.7), [100.0, -50.0, 3.0])


def information(seed: int, rank: int = 6) -> np.ndarray:
    J = np.random.default_rng(seed).normal(size=(rank, 6)) * np.repeat([30.0, 10.0], 3)
    return 1e4 * J.T @ J


@pytest.mark.parametrize("count", [0, 1, 9, 256, len(FEW)])
@pytest.mark.parametrize("T", [np.eye(4), T_MAP_SENSOR], ids=["level", "turned"])
def test_information_of_surfaces_is_that_of_the_reference(T: np.ndarray, count: int):
    grid, points, whole = SurfaceGrid.of(SURFACE, 0.5), FEW[:count], information(count)
    axes = principal_axes(whole)
    expected = faced_information(whole, axes, *told_in(grid, points, T, axes, 0.4))
    faced = native.faced_information(grid.tables, points, T, whole, 0.4)
    np.testing.assert_allclose(faced, expected, rtol=1e-3, atol=1e-4 * np.trace(whole))
    assert count < len(FEW) or np.trace(faced) > 0.01 * np.trace(whole)


def test_points_far_from_all_surfaces_tell_nothing():
    grid = SurfaceGrid.of(SURFACE, 0.5)
    far = FEW + np.float32(500)
    assert not native.faced_information(grid.tables, far, np.eye(4), information(1), 0.4).any()


@pytest.mark.parametrize("rank", range(7))
@pytest.mark.parametrize("T_map_level", [np.eye(4), TURNED], ids=["level", "turned"])
def test_a_covariance_is_that_of_the_reference(T_map_level: np.ndarray, rank: int):
    for seed in range(20):
        found = native.pose_covariance(information(seed, rank), T_map_level, 0.1)
        expected = reference.pose_covariance(
            information(seed, rank), T_map_level, RegistrationConfig(map_voxel_m=0.1)
        )
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
        free, wanted = free_directions(found), reference.free_directions(expected)
        assert [one.motion for one in free] == [one.motion for one in wanted]
        np.testing.assert_allclose([one.sigma for one in free], [one.sigma for one in wanted], rtol=1e-6)


def test_a_matrix_that_is_not_finite_is_refused():
    wrong = np.eye(6)
    wrong[2, 3] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        native.pose_covariance(wrong, np.eye(4), 0.1)
    with pytest.raises(ValueError, match="not finite"):
        native.free_axes(wrong, 0.2, 0.03)
