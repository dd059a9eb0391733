"""Bounds of points are those that NumPy finds row by row."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix_builder.mesh.bounds import bounds, extent, in_all


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("columns", [2, 3])
def test_bounds_hold_all_points_and_no_more(columns: int, kind: type):
    points = np.random.default_rng(columns).normal(size=(57, columns)).astype(kind)
    low, high = bounds(points)
    assert (low == points.min(axis=0)).all()
    assert (high == points.max(axis=0)).all()
    assert (extent(points) == high - low).all()
    assert (extent(points[:1]) == 0).all()


def test_a_row_holds_where_all_of_its_columns_do():
    holds = np.random.default_rng(3).random((64, 3)) < 0.7
    assert (in_all(holds) == holds.all(axis=1)).all()
