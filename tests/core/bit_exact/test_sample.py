import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.bit_exact.sample import rows_by_chance


@given(count=st.integers(0, 5000), at_most=st.integers(1, 600))
def test_rows_are_as_many_as_asked_distinct_and_in_order(count, at_most):
    rows = rows_by_chance(count, at_most)
    assert len(rows) == min(count, at_most)
    assert (np.diff(rows) > 0).all()
    assert not len(rows) or (rows[0] >= 0 and rows[-1] < count)


def test_rows_by_chance_are_spread_over_all():
    rows = rows_by_chance(10_000, 100)
    assert (rows // 100).tolist() == list(range(100))  # one of each run


def test_the_rows_are_those_of_the_protocol():
    """Computed by hand from clients/protocol/on-the-robot.md: every client must take these."""
    assert rows_by_chance(10, 4).tolist() == [0, 2, 5, 8]


@pytest.mark.parametrize("period", [2, 3, 4, 16, 64])
def test_what_repeats_is_taken_as_often_as_it_occurs(period):
    rows = rows_by_chance(64_000, 64_000 // period)  # a stride would take one phase alone
    phase = np.bincount(rows % period, minlength=period) / len(rows)
    np.testing.assert_allclose(phase, 1 / period, atol=0.02)
