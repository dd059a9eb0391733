import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.portable.sample import rows_by_chance, rows_by_place


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
    """Reckoned by hand from clients/protocol/on-the-robot.md: no client may take others."""
    assert rows_by_chance(10, 4).tolist() == [0, 2, 5, 8]


@pytest.mark.parametrize("period", [2, 3, 4, 16, 64])
def test_what_repeats_is_taken_as_often_as_it_occurs(period):
    rows = rows_by_chance(64_000, 64_000 // period)  # a stride would take one phase alone
    phase = np.bincount(rows % period, minlength=period) / len(rows)
    np.testing.assert_allclose(phase, 1 / period, atol=0.02)


def columns(storeys=2, side=40):
    """Viewpoints as the build orders them: column by column, lower storey then upper."""
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float), indexing="ij")
    floor = np.stack([x.ravel(), y.ravel()], axis=1)
    each = [np.column_stack([floor, np.full(len(floor), 1.0 + 3 * storey)]) for storey in range(storeys)]
    return np.stack(each, axis=1).reshape(-1, 3)


@pytest.mark.parametrize("at_most", [100, 400, 800, 1600])
def test_each_storey_gets_its_share(at_most):
    points = columns()
    upper = (points[rows_by_place(points, at_most, 3.0)][:, 2] > 2).mean()
    assert upper == pytest.approx(0.5, abs=0.13)


def test_crowded_places_get_no_more_than_lonely_ones():
    rng = np.random.default_rng(1)
    crowd = rng.uniform(0, 3, (5000, 3))
    lonely = np.arange(100)[:, None] * [3.0, 0, 0] + [10.5, 1.5, 1.5]
    rows = rows_by_place(np.concatenate([crowd, lonely]), 120, 3.0)
    assert len(rows) == 120
    assert (rows >= 5000).sum() == 100  # each lonely one before the crowd's second
    assert (np.diff(rows) > 0).all()


def test_all_points_where_there_are_no_more():
    points = columns(side=5)
    assert rows_by_place(points, 50, 3.0).tolist() == list(range(50))
    assert rows_by_place(points[:0], 5, 3.0).tolist() == []


def test_the_same_seed_gives_the_same_rows():
    points = columns()
    np.testing.assert_array_equal(
        rows_by_place(points, 99, 3.0, seed=3), rows_by_place(points, 99, 3.0, seed=3)
    )
