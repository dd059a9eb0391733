"""Equations 4 and 6, compared with slow code written after the paper, column by column."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from firstfix.descriptor.similarity import Columns, best_shift, similarity

HEIGHT_M = st.one_of(st.just(0.0), st.just(0.0), st.floats(2**-7, 32, width=16))


@st.composite
def contexts(draw, count=st.integers(1, 4)) -> np.ndarray:
    """(n, rings, sectors) float16 heights, most cells and many whole columns empty."""
    shape = (draw(count), draw(st.integers(1, 5)), draw(st.integers(2, 8)))
    heights = draw(hnp.arrays(np.float16, shape, elements=HEIGHT_M, fill=st.just(np.float16(0))))
    return heights * draw(hnp.arrays(np.bool_, (shape[0], 1, shape[2])))


@st.composite
def two_batches(draw) -> tuple[np.ndarray, np.ndarray]:
    both = draw(contexts(st.integers(2, 6)))
    cut = draw(st.integers(1, len(both) - 1))
    return both[:cut], both[cut:]


def some_contexts(seed: int, count: int, rings: int = 5, sectors: int = 12) -> np.ndarray:
    rng = np.random.default_rng(seed)
    heights = rng.uniform(0.1, 6, (count, rings, sectors)) * (rng.random((count, rings, sectors)) < 0.3)
    return (heights * (rng.random((count, 1, sectors)) < 0.7)).astype(np.float16)


def slow_similarity(x: np.ndarray, y: np.ndarray) -> float:
    """Equation 4 of two (rings, sectors) contexts, in slow and readable code."""
    total, counted = 0.0, 0
    for a, b in zip(x.astype(float).T, y.astype(float).T, strict=True):
        length_a, length_b = math.hypot(*a), math.hypot(*b)
        if not length_a and not length_b:
            continue
        counted += 1
        if length_a and length_b:
            total += sum(a * b) / (length_a * length_b)
    return total / counted if counted else 0.0


def slow_similarities(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.array([[slow_similarity(a, b) for b in y] for a in x])


@settings(max_examples=150, deadline=None, derandomize=True)
@given(two_batches())
def test_similarity_is_that_of_the_slow_reference(batches):
    x, y = batches
    got = similarity(Columns.of(x), Columns.of(y))
    assert got.shape == (len(x), len(y))
    assert np.allclose(got, slow_similarities(x, y), rtol=0, atol=2e-6)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(two_batches())
def test_similarity_is_symmetric_and_from_0_to_1(batches):
    x, y = (Columns.of(batch) for batch in batches)
    there, back = similarity(x, y), similarity(y, x)
    assert np.allclose(there, back.T, rtol=0, atol=1e-6)
    for got in (there, similarity(x, x), similarity(y, y)):
        assert (got >= 0).all()
        assert (got <= 1).all()


def test_the_range_ends_at_1_also_after_rounding():
    # 7 equal columns: rounded, the sum of their cosines is often a hair above 7
    batch = np.random.default_rng(0).uniform(0.1, 9, (200, 5, 1)).repeat(7, axis=2)
    columns = Columns.of(batch)
    assert np.einsum("nd,nd->n", columns.unit, columns.unit).max() > 7
    assert similarity(columns, columns).max() == 1


@pytest.mark.filterwarnings("error")
def test_nothing_is_like_an_empty_context():
    empty = np.zeros((2, 5, 12), np.float16)
    some = some_contexts(2, 3)
    assert not similarity(Columns.of(empty), Columns.of(empty)).any()
    assert not similarity(Columns.of(empty), Columns.of(some)).any()
    assert not similarity(Columns.of(some), Columns.of(empty)).any()
    for query, templates in ((empty[:1], some), (some[:1], empty)):
        shift, score = best_shift(Columns.of(query), Columns.of(templates), np.array([4, 0, 1]))
        assert (shift == 4).all()
        assert (score == 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_turning_rolls_the_columns(seed):
    context = some_contexts(seed, 1, 4, 9)
    shifts = np.array([0, 3, -2, 8, 9, -11])
    turned = Columns.of(context).turned(shifts)
    rolled = Columns.of(np.concatenate([np.roll(context, s, axis=2) for s in shifts]))
    assert np.array_equal(turned.unit, rolled.unit)
    assert np.array_equal(turned.filled, rolled.filled)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "shifts", [np.arange(12), np.array([0, -1, 1]), np.array([0]), np.array([5, 2, -3, 11])], ids=str
)
def test_best_shift_is_the_best_of_the_rolled_references(seed, shifts):
    """Similarity with column j of the query on column j + s of the template, for every shift s."""
    query, templates = some_contexts(seed, 1), some_contexts(50 + seed, 8)
    templates[3] = np.roll(query[0], 5, axis=1)
    templates[4] = np.roll(query[0], -1, axis=1)
    shift, score = best_shift(Columns.of(query), Columns.of(templates), shifts)
    every = np.array([[slow_similarity(np.roll(query[0], s, axis=1), t) for s in shifts] for t in templates])
    assert score == pytest.approx(every.max(axis=1), abs=2e-6)
    assert shift.tolist() == shifts[every.argmax(axis=1)].tolist()
    if 5 in shifts:
        assert (shift[3], score[3]) == (5, pytest.approx(1, abs=2e-6))


@pytest.mark.parametrize(
    "shifts", [[0, -1, 1], [1, 0, -1], [-1, 1, 0], [2, 5, 4, 0], list(range(12))], ids=str
)
def test_ties_go_to_the_earlier_shift(shifts):
    # one filled cell a column and so cosines of 0 and 1: the ties are exact
    alike_everywhere = np.zeros((1, 3, 12), np.float16)
    alike_everywhere[0, 1] = 2.0
    every_third = np.zeros((1, 3, 12), np.float16)
    every_third[0, 0, ::3] = 1.5
    shifts = np.array(shifts)
    assert best_shift(Columns.of(alike_everywhere), Columns.of(alike_everywhere), shifts)[0] == shifts[0]
    first_of_three = next(s for s in shifts if s % 3 == 0)
    assert best_shift(Columns.of(every_third), Columns.of(every_third), shifts)[0] == first_of_three
