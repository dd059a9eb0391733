"""Samples by the chance of each place, and runs of equal rows."""

from __future__ import annotations

import numpy as np

from firstfix_builder.mesh.places.chance import begins_run, chance_of, rank_in_run, rows_by_cell, rows_by_rank

RNG = np.random.default_rng(1)
PLACES = RNG.uniform(-40, 40, (5000, 3)).astype(np.float32)


def test_chance_is_even_and_of_the_place_alone():
    chance = chance_of(PLACES, 3)
    assert (chance[::-1] == chance_of(PLACES[::-1], 3)).all()
    share = np.bincount((chance >> np.uint32(28)).astype(int), minlength=16) / len(PLACES)
    assert np.abs(share - 1 / 16).max() < 0.02
    assert (chance != chance_of(PLACES, 4)).mean() > 0.99
    assert len(np.unique(chance)) > 0.99 * len(PLACES)
    zeros = np.array([[0.0, 1, 2], [-0.0, 1, 2]], np.float32)
    assert np.diff(chance_of(zeros, 0).astype(int)) == 0


def test_each_cell_gives_up_to_so_many():
    rows = rows_by_cell(PLACES, (8.0, 8.0, 4.0), 2)
    cell = np.floor(PLACES.astype(float) / (8.0, 8.0, 4.0))
    cells, count = np.unique(cell, axis=0, return_counts=True)
    chosen, chosen_count = np.unique(cell[rows], axis=0, return_counts=True)
    assert (chosen == cells).all()
    assert (chosen_count == np.minimum(count, 2)).all()
    assert (np.diff(rows) > 0).all()
    few = rows_by_cell(PLACES, (8.0, 8.0, 4.0), 3, one_of=4)
    few_cells, few_count = np.unique(cell[few], axis=0, return_counts=True)
    assert (few_cells == cells).all()
    assert (few_count == np.minimum(np.ceil(count / 4), 3)).all()


def test_points_of_other_cells_change_nothing_here():
    here = PLACES[:, 0] < 0
    more = np.concatenate([RNG.uniform([8, -40, -40], 40, (700, 3)).astype(np.float32), PLACES])
    some, others = (
        PLACES[rows_by_cell(PLACES, (8.0, 8.0, 8.0), 3)],
        more[rows_by_cell(more, (8.0, 8.0, 8.0), 3)],
    )
    assert here.any()
    assert (some[some[:, 0] < 0] == others[others[:, 0] < 0]).all()


def test_a_ranking_loses_as_many_as_were_replaced():
    replaced = PLACES.copy()
    replaced[:500] += np.float32(0.25)
    before = {tuple(row) for row in PLACES[rows_by_rank(PLACES, 1000)].tolist()}
    after = {tuple(row) for row in replaced[rows_by_rank(replaced, 1000)].tolist()}
    assert len(before) == len(after) == 1000
    assert 850 < len(before & after) < 950
    assert len(rows_by_rank(PLACES, 10_000)) == len(PLACES)


def test_rows_are_numbered_within_their_run():
    rows = np.array([[0, 0], [0, 0], [0, 1], [2, 1], [2, 1], [2, 1], [0, 0]])
    assert begins_run(rows).tolist() == [True, False, True, True, False, False, True]
    assert rank_in_run(rows).tolist() == [0, 1, 0, 0, 1, 2, 0]
    for count in (0, 1):
        rows = np.zeros((count, 2), np.int64)
        assert begins_run(rows).tolist() == [True] * count
        assert rank_in_run(rows).tolist() == [0] * count
