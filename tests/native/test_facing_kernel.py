"""Sums of the information of surfaces along principal directions: the kernel against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import firstfix.native as native
from firstfix.engine.registration.surface_grid import SurfaceGrid
from tests.native.kernel_cases import FEW, R_LEVEL_SENSOR, SURFACE, T_MAP_SENSOR
from tests.reference.facing import told_in

AXES = np.stack([R_LEVEL_SENSOR, np.eye(3)])


@pytest.mark.parametrize("count", [0, 1, 9, 256, len(FEW)])
@pytest.mark.parametrize("T", [np.eye(4), T_MAP_SENSOR], ids=["level", "turned"])
def test_information_of_surfaces_is_that_of_the_reference(T: np.ndarray, count: int):
    grid, points = SurfaceGrid.of(SURFACE, 0.5), FEW[:count]
    sums, weights, squares = native.told(grid.tables, points, T, AXES, 0.4)
    expected, all_weights, all_squares = told_in(grid, points, T, AXES, 0.4)
    np.testing.assert_allclose(sums, expected, rtol=1e-3, atol=1e-3)
    assert (weights, squares) == pytest.approx((all_weights, all_squares), rel=1e-4, abs=1e-5)
    assert count < len(FEW) or weights > 20


def test_points_far_from_all_surfaces_tell_nothing():
    grid = SurfaceGrid.of(SURFACE, 0.5)
    sums, weights, squares = native.told(grid.tables, FEW + np.float32(500), np.eye(4), AXES, 0.4)
    assert not sums.any()
    assert (weights, squares) == (0, 0)
