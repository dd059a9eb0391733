"""Angles, eigenvectors and samples that are the same to the last bit on every processor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.bit_exact.atan2 import atan2_turns
from firstfix.bit_exact.eigh3 import smallest_eigenvectors
from firstfix.bit_exact.sample import rows_by_chance


def test_atan2_is_the_angle():
    rng = np.random.default_rng(0)
    y, x = rng.normal(0, 20, (2, 200_000)).astype(np.float32)
    true = np.arctan2(y.astype(np.float64), x.astype(np.float64)) / (2 * np.pi)
    assert np.abs(atan2_turns(y, x) - true).max() < 1e-7


@pytest.mark.parametrize(
    ("y", "x", "wanted"), [(0, 0, 0), (0, 2, 0), (3, 0, 0.25), (-3, 0, -0.25), (0, -1, 0.5), (1e-40, -1, 0.5)]
)
def test_atan2_is_exact_on_the_axes(y, x, wanted):
    assert atan2_turns(np.float32([y]), np.float32([x])) == np.float32(wanted)


def test_atan2_does_not_depend_on_the_processor():
    """Bits of a few angles, as clients in other languages compute them."""
    y, x = np.float32([[1, -2, 3.5, 0.1], [2, -1, -0.25, 1]])
    assert atan2_turns(y, x).view(np.uint32).tolist() == [1033314345, 3198535690, 1048956807, 1015149214]


def test_eigenvalues_and_the_smallest_ones_axis():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(500, 8, 3)) * rng.uniform(0.001, 2, (500, 1, 3))
    matrices = np.einsum("nki,nkj->nij", points, points)
    values, axes = smallest_eigenvectors(matrices)
    wanted, vectors = np.linalg.eigh(matrices)
    np.testing.assert_allclose(values, wanted, atol=1e-9 * wanted.max())
    assert np.abs(np.einsum("ni,ni->n", axes, vectors[:, :, 0])).min() > 1 - 1e-9
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1, atol=1e-12)


def test_eigenvectors_of_diagonal_matrices_and_of_none():
    values, axes = smallest_eigenvectors(np.stack([np.diag([3.0, 1.0, 2.0]), np.zeros((3, 3))]))
    assert values.tolist() == [[1, 2, 3], [0, 0, 0]]
    assert axes.tolist() == [[0, 1, 0], [1, 0, 0]]
    assert smallest_eigenvectors(np.empty((0, 3, 3)))[1].shape == (0, 3)


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
def test_rows_by_chance_keep_the_share_of_what_repeats(period):
    rows = rows_by_chance(64_000, 64_000 // period)  # a stride would take one phase alone
    phase = np.bincount(rows % period, minlength=period) / len(rows)
    np.testing.assert_allclose(phase, 1 / period, atol=0.02)
