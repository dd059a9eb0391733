"""The columns of a map that checks look at."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix_builder.sources.check_map.surfaces import MAX_TABLE, numbered


@pytest.mark.parametrize("far", [0, 5 * MAX_TABLE], ids=["a table", "a stray cell far away"])
def test_cells_are_numbered_by_their_coordinates(far: int):
    rng = np.random.default_rng(3)
    cells = np.concatenate([rng.integers(-20, 20, (500, 2)), [[far, -7], [-3, far]]])
    number, count = numbered(cells)
    known, first = np.unique(cells, axis=0, return_index=True)
    assert np.array_equal(number[first], np.arange(len(known)))
    assert np.array_equal(known[number], cells)
    assert np.array_equal(count, [(cells == one).all(axis=1).sum() for one in known])
