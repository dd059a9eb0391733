import numpy as np
import pytest

from firstfix_builder.mesh.places.chance import begins_run, rank_in_run

ROWS = np.array([[0, 0], [0, 0], [0, 1], [2, 1], [2, 1], [2, 1], [0, 0]])


def test_a_run_begins_where_a_row_differs_from_the_one_before():
    assert begins_run(ROWS).tolist() == [True, False, True, True, False, False, True]


def test_rows_are_numbered_within_their_run():
    assert rank_in_run(ROWS).tolist() == [0, 1, 0, 0, 1, 2, 0]


@pytest.mark.parametrize("count", [0, 1])
def test_no_row_and_one_row(count):
    rows = np.zeros((count, 2), np.int64)
    assert begins_run(rows).tolist() == [True] * count
    assert rank_in_run(rows).tolist() == [0] * count
