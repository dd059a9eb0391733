"""The columns of a map of which a part is looked at."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix_builder.sources.check_map import surfaces
from tests.every_case import every_case


@every_case("spread_m", [5.0, 300.0, 1e6])
def test_columns_are_numbered_by_x_then_y_with_a_table_and_by_sorting(spread_m: float):
    cells = np.floor(np.random.default_rng(7).normal(0, spread_m, (5000, 2))).astype(np.int64)
    column, count = surfaces._columns(cells)
    kept, expected, counted = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    np.testing.assert_array_equal(column, expected.ravel())
    np.testing.assert_array_equal(count, counted)
    assert len(kept) == len(count)


def test_both_ways_give_the_same_points(monkeypatch: pytest.MonkeyPatch):
    points = np.random.default_rng(8).uniform([-90, -70, 0], [80, 60, 3], (20_000, 3))
    by_table = surfaces.surfaces(points, 0.5, 4000)
    monkeypatch.setattr(surfaces, "_MAX_TABLE", 0)
    np.testing.assert_array_equal(by_table.points, surfaces.surfaces(points, 0.5, 4000).points)
    assert len(by_table) < 20_000
