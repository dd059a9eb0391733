"""The columns of a map that checks look at."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import BuildFailed
from firstfix_builder.sources.check_map.surfaces import MAX_TABLE, numbered, surfaces


@pytest.mark.parametrize("far", [0, 5 * MAX_TABLE], ids=["a table", "a stray cell far away"])
def test_cells_are_numbered_by_their_coordinates(far: int):
    rng = np.random.default_rng(3)
    cells = np.concatenate([rng.integers(-20, 20, (500, 2)), [[far, -7], [-3, far]]])
    number, count = numbered(cells)
    known, first = np.unique(cells, axis=0, return_index=True)
    assert np.array_equal(number[first], np.arange(len(known)))
    assert np.array_equal(known[number], cells)
    assert np.array_equal(count, [(cells == one).all(axis=1).sum() for one in known])


def test_a_stray_point_too_far_away_is_named_with_a_remedy():
    points = np.concatenate([np.random.default_rng(5).uniform(0, 9, (500, 3)), [[1e6, 1e6, 1e6]]])
    with pytest.raises(BuildFailed, match=r"1,000,000 m wide.* Remove stray points"):
        surfaces(points, 0.2, 1000)
