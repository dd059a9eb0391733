"""Rows chosen evenly by place, and one place for each block and storey."""

import numpy as np
import pytest

from firstfix_builder.viewpoints.even_sample import FloorPoints, one_per_block, rows_by_hash, rows_by_place


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


def test_by_hash_a_storey_or_a_corner_gets_its_share_too():
    points = columns()
    upper = (points[rows_by_hash(points, 200, 3.0)][:, 2] > 2).mean()
    assert 0.4 < upper < 0.6
    crowd = np.random.default_rng(2).uniform(0, 3, (3000, 3)) * [1, 1, 0]
    lonely = columns(storeys=1, side=10) + [50.0, 50.0, 0.0]
    chosen = rows_by_hash(np.concatenate([crowd, lonely]), 60, 3.0)
    assert (chosen >= len(crowd)).mean() > 0.5
    assert rows_by_hash(points[:7], 7, 3.0).tolist() == list(range(7))


def test_by_hash_a_choice_of_choices_of_tiles_is_the_choice_of_all_in_any_order():
    points = columns()
    rng = np.random.default_rng(5)
    whole = {tuple(point) for point in points[rows_by_hash(points, 150, 2.0)]}
    assert len(whole) == 150
    shuffled = points[rng.permutation(len(points))]
    tile = np.floor(shuffled[:, 0] / 8)
    parts = [shuffled[tile == number] for number in np.unique(tile)]
    kept = np.concatenate([part[rows_by_hash(part, 150, 2.0)] for part in parts])
    assert len(kept) < len(points)
    assert {tuple(point) for point in kept[rows_by_hash(kept, 150, 2.0)]} == whole


def test_by_hash_a_change_elsewhere_makes_few_others_of_the_chosen():
    points = columns()
    before = {tuple(point) for point in points[rows_by_hash(points, 200, 2.0)]}
    left = points[(points[:, 0] > 4) | (points[:, 1] > 4)]
    after = {tuple(point) for point in left[rows_by_hash(left, 200, 2.0)]}
    assert len(before & after) >= 190


def test_the_place_nearest_to_the_centre_stands_for_its_block_and_storey():
    xy = np.array([[0.1, 0.1], [0.9, 1.2], [1.9, 0.3], [2.1, 0.3], [1.1, 0.9], [-0.1, 0.5]])
    z = np.array([0.0, 0.2, 0.4, 0.0, 3.0, 0.0])
    block, standing = one_per_block(FloorPoints.alone(xy, z), 2.0)
    assert block[0] == block[1] == block[2]
    assert len({block[0], block[3], block[4], block[5]}) == 4
    assert set(standing) == {1, 3, 4, 5}
    assert (block[standing] == np.arange(4)).all()


def test_places_elsewhere_change_nothing():
    rng = np.random.default_rng(0)
    xy, z = rng.uniform(0, 40, (500, 2)), rng.uniform(0, 3, 500)
    more = rng.uniform([-90, -90], [-1, 90], (300, 2))
    alone = set(one_per_block(FloorPoints.alone(xy, z), 2.0)[1].tolist())
    every = FloorPoints.alone(np.concatenate([more, xy]), np.concatenate([np.zeros(300), z]))
    _, standing = one_per_block(every, 2.0)
    assert {row - 300 for row in standing.tolist() if row >= 300} == alone


def test_parts_are_thinned_alone_and_then_together_as_all_at_once():
    rng = np.random.default_rng(1)
    xy, z = rng.uniform(0, 8, (600, 2)), rng.uniform(0, 9, 600)
    part = rng.integers(0, 4, 600)
    group, standing = one_per_block(FloorPoints.alone(xy, z), 2.0, part)
    assert len(standing) == group.max() + 1 > 60
    low, high = (np.array([pick(z[group == one]) for one in range(len(standing))]) for pick in (min, max))
    left = FloorPoints(xy[standing], z[standing], low, high)
    again = standing[one_per_block(left, 2.0)[1]]
    assert set(again.tolist()) == set(one_per_block(FloorPoints.alone(xy, z), 2.0)[1].tolist())
    assert len(again) < len(standing)
